// Fields over time as VTKHDF 2.0, type ImageData: what ParaView 5.12 and VTK 9.3 read, and later ones.
//
// dataset                      shape                    meaning
// VTKHDF/PointData/x           (rows, along, across)    the state on the rectangle
// VTKHDF/PointData/y, w        (rows, along, across)    of constraint i: on all points of line i; with constraints on
//                                                       two sides on the half of the line that is next to them
// VTKHDF/Steps/Values          (rows)                   times
// VTKHDF/Steps/PointDataOffsets/NAME   (rows)           the row of each time
// attribute constraints of the root                     along, or twice that with constraints on two sides

#include "core/base/error.hpp"
#include "files/batched_file.hpp"
#include "files/hdf5_file.hpp"

#include <algorithm>
#include <array>
#include <map>

namespace bromwich {

using namespace hdf5;

namespace {

/// Without states, the image is a strip along the side of the constraints.
constexpr Index strip_width = 2;

void set_type(File& file, hid_t group, const std::string& value) {
  const Handle type(H5Tcopy(H5T_C_S1), H5Tclose), space(H5Screate(H5S_SCALAR), H5Sclose);
  file.checked(H5Tset_size(type, value.size()));
  file.checked(H5Tset_strpad(type, H5T_STR_NULLPAD));
  const Handle attribute(file.checked(H5Acreate2(group, "Type", type, space, H5P_DEFAULT, H5P_DEFAULT)), H5Aclose);
  file.checked(H5Awrite(attribute, type, value.data()));
}

class VtkhdfResult : public BatchedFile {
 public:
  VtkhdfResult(const FileTarget& target, const FieldGrid& grid, const ResultColumns& columns, Index expected_rows,
               const Facts& facts)
      : VtkhdfResult(target, grid, columns, File::Access::create, expected_rows) {
    set_attributes(file_, file_, facts);
    set_attribute(file_, file_, "constraints", std::int64_t(columns.constraints));
    image_ = group(file_, "VTKHDF");
    steps_ = group(image_, "Steps");
    describe_image(grid);
    const Handle data = group(image_, "PointData"), offsets = group(steps_, "PointDataOffsets");
    chunk_rows_ = std::clamp<Index>(expected_rows, 1, chunk_rows_);
    const Shape row{hsize_t(along_), hsize_t(across_)};
    for (const std::string& name : names_)
      fields_[name] = {growing_dataset(file_, data, name, H5T_IEEE_F64LE, row, chunk_rows_),
                       growing_dataset(file_, offsets, name, H5T_STD_I64LE, {}, rows_per_chunk(1))};
    values_ = growing_dataset(file_, steps_, "Values", H5T_IEEE_F64LE, {}, rows_per_chunk(1));
    count_steps(0);
  }

  VtkhdfResult(const FileTarget& target, const FieldGrid& grid, const ResultColumns& columns, Index rows,
               const std::string& run)
      : VtkhdfResult(target, grid, columns, File::Access::write, 0) {
    const auto refuse = [&](const std::string& why) {
      return Error(target.argument, "'" + target.path.string() + "' " + why,
                   "choose a new file: it gets the rows from the checkpoint on");
    };
    if (text_attribute(file_, file_, "run") != run) throw refuse("is not of the run of the checkpoint");
    image_ = existing_group("VTKHDF");
    steps_ = existing_group("VTKHDF/Steps");
    for (const std::string& name : names_) {
      if (H5Lexists(file_, ("VTKHDF/PointData/" + name).c_str(), H5P_DEFAULT) <= 0) throw refuse("has no " + name);
      fields_[name] = {open_dataset(file_, file_, "VTKHDF/PointData/" + name),
                       open_dataset(file_, file_, "VTKHDF/Steps/PointDataOffsets/" + name)};
      const Shape found = shape_of(file_, fields_[name].values);
      if (found.size() != 3 || Index(found[1]) != along_ || Index(found[2]) != across_)
        throw refuse("is of another grid");
    }
    values_ = open_dataset(file_, file_, "VTKHDF/Steps/Values");
    if (Index(shape_of(file_, values_)[0]) < rows) throw refuse("ends before the checkpoint");
    count_steps(rows);
    for (const auto& [name, field] : fields_) {
      set_rows(file_, field.values, rows);
      set_rows(file_, field.offsets, rows);
    }
    set_rows(file_, values_, rows);
    file_.flush();
    continue_after(rows);
  }

  /// It has fields alone.
  void add(const std::vector<TimeSeries>&) override {}

  void set(const Facts& facts) override {
    flush();
    set_attributes(file_, file_, facts);
    file_.flush();
  }

 protected:
  Index chunk_rows() const override { return chunk_rows_; }
  Index flush_rows() const override { return rows_per_flush(along_ * across_); }

  void write(const ResultRows& rows, Index written) override {
    const Index count = rows.t.size();
    std::vector<std::int64_t> numbers;
    for (Index j = 0; j < count; ++j) numbers.push_back(written + j);
    for (const auto& [name, field] : fields_) {
      const RowMatrix points = on_points(name, name == "x" ? rows.x : name == "y" ? rows.y : rows.w);
      append_rows(file_, field.values, H5T_NATIVE_DOUBLE, written, count, points.data());
      append_rows(file_, field.offsets, H5T_NATIVE_INT64, written, count, numbers.data());
    }
    append_rows(file_, values_, H5T_NATIVE_DOUBLE, written, count, rows.t.data());
    file_.flush();  // the rows are there before they are counted
    count_steps(written + count);
  }

 private:
  struct Field {
    Handle values, offsets;
  };

  VtkhdfResult(const FileTarget& target, const FieldGrid& grid, const ResultColumns& columns, File::Access access,
               Index expected_rows)
      : along_(grid.along),
        across_(columns.states.empty() ? strip_width : grid.across),
        file_((check(target, grid, columns), target), access, expected_rows / rows_per_chunk(along_ * across_) + 1),
        chunk_rows_(rows_per_chunk(along_ * across_)) {
    if (!columns.states.empty()) names_.push_back("x");
    names_.push_back("y");
    if (columns.slack) names_.push_back("w");
  }

  static void check(const FileTarget& target, const FieldGrid& grid, const ResultColumns& columns) {
    const std::string name = "'" + target.path.string() + "' ";
    if (columns.constraints != grid.along && columns.constraints != 2 * grid.along)
      throw Error(target.argument, name + "needs one constraint per line of the grid, or two", "write a file .h5");
    if (!columns.states.empty() && Index(columns.states.size()) != grid.along * grid.across)
      throw Error(target.argument, name + "holds x of all points or of none", "add --states all or --states none");
    if (grid.along < 2 || (!columns.states.empty() && grid.across < 2))
      throw Error(target.argument, name + "needs a grid of at least 2 x 2 points", "write a file .h5");
  }

  static double first(double given, double spacing) { return given > 0 ? given : spacing; }
  bool has_x() const { return names_.front() == "x"; }

  Handle group(hid_t parent, const std::string& name) {
    return {file_.checked(H5Gcreate2(parent, name.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT)), H5Gclose};
  }
  Handle existing_group(const std::string& name) {
    return {file_.checked(H5Gopen2(file_, name.c_str(), H5P_DEFAULT)), H5Gclose};
  }

  /// Points of lines lie at x1 = spacing, 2 spacing, ...; a strip at 0 and spacing, where the constraints are.
  void describe_image(const FieldGrid& grid) {
    set_attribute(file_, image_, "Version", std::vector<std::int64_t>{2, 0});
    set_type(file_, image_, "ImageData");
    set_attribute(file_, image_, "WholeExtent", std::vector<std::int64_t>{0, across_ - 1, 0, along_ - 1, 0, 0});
    set_attribute(file_, image_, "Origin",
                  std::vector<double>{has_x() ? first(grid.across_first, grid.across_spacing) : 0,
                                      first(grid.along_first, grid.along_spacing), 0});
    set_attribute(file_, image_, "Spacing", std::vector<double>{grid.across_spacing, grid.along_spacing, 1});
    set_attribute(file_, image_, "Direction", std::vector<double>{1, 0, 0, 0, 1, 0, 0, 0, 1});
  }

  /// Rows of x as they are, rows of y and w with each value on all points of its line, or of its half of the line.
  RowMatrix on_points(const std::string& name, const Eigen::Ref<const RowMatrix>& values) const {
    if (name == "x") return values;
    RowMatrix points(values.rows(), along_ * across_);
    const bool two_sides = values.cols() == 2 * along_;
    const Index near = two_sides ? (across_ + 1) / 2 : across_;
    for (Index j = 0; j < values.rows(); ++j)
      for (Index line = 0; line < along_; ++line) {
        points.row(j).segment(line * across_, near).setConstant(values(j, line));
        if (two_sides)
          points.row(j).segment(line * across_ + near, across_ - near).setConstant(values(j, along_ + line));
      }
    return points;
  }

  void count_steps(Index rows) {
    set_attribute(file_, steps_, "NSteps", std::int64_t(rows));
    file_.flush();
  }

  Index along_, across_;
  File file_;
  Index chunk_rows_;
  std::vector<std::string> names_;
  Handle image_, steps_, values_;
  std::map<std::string, Field> fields_;
};

}  // namespace

std::unique_ptr<ResultFile> create_vtkhdf(const FileTarget& target, const FieldGrid& grid, const ResultColumns& columns,
                                          Index expected_rows, const Facts& facts) {
  return std::make_unique<VtkhdfResult>(target, grid, columns, expected_rows, facts);
}

std::unique_ptr<ResultFile> continue_vtkhdf(const FileTarget& target, const FieldGrid& grid,
                                            const ResultColumns& columns, Index rows, const std::string& run) {
  return std::make_unique<VtkhdfResult>(target, grid, columns, rows, run);
}

}  // namespace bromwich
