// Results in HDF5, with the dimension scales and attributes that netCDF-4, h5netcdf and xarray expect.
//
// dataset          shape            meaning
// t                (rows)           times; scale of the first dimension
// constraint       (n)              0, 1, ..., n-1; scale
// state            (k)              components of the state that are recorded; scale
// y, w             (rows, n)        w = N x + M y + g
// x                (rows, k)
// constraint_name  (n)              names
// state_name       (k)
// energy, ...      (rows)           with --energies

#include "core/base/error.hpp"
#include "files/batched_file.hpp"
#include "files/hdf5_file.hpp"

#include <hdf5_hl.h>

#include <algorithm>

namespace bromwich {

using namespace hdf5;

namespace {

struct Column {
  Handle dataset;
  Index width = 0;
};

class Hdf5Result : public BatchedFile {
 public:
  Hdf5Result(const FileTarget& target, const ResultColumns& columns, Index expected_rows, const Facts& facts)
      : width_(row_width(columns)),
        file_(target, File::Access::create, expected_rows / rows_per_chunk(width_) + 1),
        chunk_rows_(std::clamp<Index>(expected_rows, 1, rows_per_chunk(width_))) {
    set_attributes(file_, file_, facts);
    add_scales(columns);
    t_ = add_variable("t", {}, nullptr, columns.t_unit, "time");
    H5DSset_scale(t_.dataset, "t");
    const Index n = columns.constraints, k = Index(columns.states.size());
    if (n > 0) y_ = add_variable("y", {hsize_t(n)}, &constraint_, columns.y_unit, "complementary variable y");
    if (n > 0 && columns.slack)
      w_ = add_variable("w", {hsize_t(n)}, &constraint_, columns.w_unit, "complementary variable w = N x + M y + g");
    if (k > 0) x_ = add_variable("x", {hsize_t(k)}, &state_, columns.x_unit, "state");
    file_.flush();
  }

  /// Continues an existing file after its first `rows` rows.
  Hdf5Result(const FileTarget& target, const ResultColumns& columns, Index rows, const std::string& run)
      : width_(row_width(columns)), file_(target, File::Access::write), chunk_rows_(rows_per_chunk(width_)) {
    const Index n = columns.constraints, k = Index(columns.states.size());
    require_same_run(run);
    t_ = existing("t", 1, true);
    y_ = existing("y", n, n > 0);
    w_ = existing("w", n, n > 0 && columns.slack);
    x_ = existing("x", k, k > 0);
    if (const Index held = Index(shape_of(file_, t_.dataset)[0]); held < rows)
      throw Error(target.argument,
                  "'" + target.path.string() + "' has " + std::to_string(held) + " rows and the checkpoint is at row " +
                      std::to_string(rows - 1),
                  "choose a new file: it gets the rows from the checkpoint on");
    for (const Column* column : {&t_, &y_, &w_, &x_})
      if (column->width > 0) set_rows(file_, column->dataset, rows);
    file_.flush();
    continue_after(rows);
  }

  void set(const Facts& facts) override {
    flush();
    set_attributes(file_, file_, facts);
    file_.flush();
  }

  void add(const std::vector<TimeSeries>& series) override {
    flush();
    for (const TimeSeries& one : series) {
      const Column column = add_variable(one.name, {}, nullptr, "", one.meaning);
      append_rows(file_, column.dataset, H5T_NATIVE_DOUBLE, 0, one.values.size(), one.values.data());
    }
    file_.flush();
  }

 protected:
  Index chunk_rows() const override { return chunk_rows_; }
  Index flush_rows() const override { return rows_per_flush(width_); }

  void write(const ResultRows& rows, Index written) override {
    const auto add = [&](const Column& column, const double* values) {
      if (column.width > 0) append_rows(file_, column.dataset, H5T_NATIVE_DOUBLE, written, rows.t.size(), values);
    };
    add(t_, rows.t.data());
    add(y_, rows.y.data());
    add(w_, rows.w.data());
    add(x_, rows.x.data());
    file_.flush();
  }

 private:
  static Index row_width(const ResultColumns& columns) {
    return std::max(columns.constraints, Index(columns.states.size()));
  }

  void add_scales(const ResultColumns& columns) {
    if (columns.constraints > 0) {
      std::vector<std::int64_t> numbers;
      for (Index i = 0; i < columns.constraints; ++i) numbers.push_back(i);
      constraint_ = add_scale("constraint", numbers, constraint_names(columns));
    }
    if (!columns.states.empty())
      state_ = add_scale("state", {columns.states.begin(), columns.states.end()}, state_names(columns));
  }

  Handle add_scale(const std::string& name, const std::vector<std::int64_t>& numbers,
                   const std::vector<std::string>& names) {
    Handle scale = fixed_dataset(file_, file_, name, H5T_NATIVE_INT64, {numbers.size()}, numbers.data());
    file_.checked(H5DSset_scale(scale, name.c_str()));
    const Handle words = text_dataset(file_, file_, name + "_name", names);
    file_.checked(H5DSattach_scale(words, scale, 0));
    return scale;
  }

  Column add_variable(const std::string& name, const Shape& row, const Handle* second, const std::string& unit,
                      const std::string& meaning) {
    Column column{growing_dataset(file_, file_, name, H5T_IEEE_F64LE, row, chunk_rows_), 1};
    if (!row.empty()) column.width = Index(row[0]);
    if (t_.width > 0) file_.checked(H5DSattach_scale(column.dataset, t_.dataset, 0));
    if (second) file_.checked(H5DSattach_scale(column.dataset, *second, 1));
    set_attribute(file_, column.dataset, "long_name", meaning);
    if (!unit.empty()) set_attribute(file_, column.dataset, "units", unit);
    return column;
  }

  void require_same_run(const std::string& run) {
    if (text_attribute(file_, file_, "run") == run) return;
    throw Error(file_.target().argument, "'" + file_.target().path.string() + "' is not of the run of the checkpoint",
                "choose a new file: it gets the rows from the checkpoint on");
  }

  Column existing(const std::string& name, Index width, bool wanted) {
    const bool found = file_.checked(H5Lexists(file_, name.c_str(), H5P_DEFAULT)) > 0;
    Column column;
    if (found) column = {open_dataset(file_, file_, name), 1};
    if (const Shape shape = found ? shape_of(file_, column.dataset) : Shape{}; shape.size() > 1)
      column.width = Index(shape[1]);
    if (found == wanted && (!found || column.width == width)) return column;
    throw Error(file_.target().argument, "'" + file_.target().path.string() + "' has other columns of " + name,
                "ask for the same columns, or choose a new file");
  }

  Index width_;
  File file_;
  Index chunk_rows_;
  Handle constraint_, state_;
  Column t_, y_, w_, x_;
};

}  // namespace

void require_hdf5(const FileTarget&) {}

std::unique_ptr<ResultFile> create_hdf5(const FileTarget& target, const ResultColumns& columns, Index expected_rows,
                                        const Facts& facts) {
  return std::make_unique<Hdf5Result>(target, columns, expected_rows, facts);
}

std::unique_ptr<ResultFile> continue_hdf5(const FileTarget& target, const ResultColumns& columns, Index rows,
                                          const std::string& run) {
  return std::make_unique<Hdf5Result>(target, columns, rows, run);
}

}  // namespace bromwich
