// Reads the layouts of hdf5_result.cpp and vtkhdf.cpp.

#include "core/base/error.hpp"
#include "files/hdf5_file.hpp"
#include "files/stored_result.hpp"
#include "files/sweep_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <sstream>

namespace bromwich {

using namespace hdf5;

namespace {

[[noreturn]] void refuse(const File& file, const std::string& what) {
  throw Error(file.target().argument, "'" + file.target().path.string() + "' " + what,
              "give a file that 'bromwich solve --out' has written");
}

bool has(File& file, const std::string& name) { return file.checked(H5Lexists(file, name.c_str(), H5P_DEFAULT)) > 0; }

/// All rows of a dataset of one or two dimensions; no rows if there is none.
RowMatrix table(File& file, const std::string& name) {
  if (!has(file, name)) return {};
  const Handle data = open_dataset(file, file, name);
  const Shape shape = shape_to_read(file, data);
  if (shape.empty() || shape.size() > 2)
    refuse(file, "has a dataset " + name + " of " + std::to_string(shape.size()) + " dimensions");
  const Index rows = Index(shape[0]), columns = shape.size() == 2 ? Index(shape[1]) : 1;
  RowMatrix values(rows, columns);
  if (values.size() > 0) read_all(file, data, H5T_NATIVE_DOUBLE, values.data());
  return values;
}

/// A dataset of one column; no rows if there is none.
Vector column(File& file, const std::string& name) {
  const RowMatrix values = table(file, name);
  if (values.size() == 0) return {};
  if (values.cols() != 1) refuse(file, "has several columns in its dataset " + name);
  return values.col(0);
}

std::vector<std::string> words(File& file, const std::string& name) {
  if (!has(file, name)) return {};
  const Handle data = open_dataset(file, file, name);
  const Handle stored(file.checked(H5Dget_type(data)), H5Tclose);
  const Shape shape = shape_to_read(file, data);
  if (shape.size() != 1 || H5Tget_class(stored) != H5T_STRING || H5Tis_variable_str(stored) <= 0) return {};
  const Handle type(H5Tcopy(H5T_C_S1), H5Tclose), space(file.checked(H5Dget_space(data)), H5Sclose);
  H5Tset_size(type, H5T_VARIABLE);
  H5Tset_cset(type, H5Tget_cset(stored));
  std::vector<char*> texts(shape[0], nullptr);
  if (!texts.empty()) read_all(file, data, type, texts.data());
  std::vector<std::string> found;
  for (const char* text : texts) found.emplace_back(text ? text : "");
  H5Dvlen_reclaim(type, space, H5P_DEFAULT, texts.data());
  return found;
}

std::string unit_of(File& file, const std::string& name) {
  return has(file, name) ? text_attribute(file, open_dataset(file, file, name), "units") : "";
}

herr_t collect_name(hid_t /*object*/, const char* name, const H5A_info_t* /*info*/, void* into) {
  static_cast<std::vector<std::string>*>(into)->emplace_back(name);
  return 0;
}

herr_t collect_link(hid_t /*group*/, const char* name, const H5L_info_t* /*info*/, void* into) {
  static_cast<std::vector<std::string>*>(into)->emplace_back(name);
  return 0;
}

/// Datasets of floats with a value at every time, besides t.
std::vector<TimeSeries> others(File& file, Index rows) {
  std::vector<std::string> names;
  file.checked(H5Literate(file, H5_INDEX_NAME, H5_ITER_NATIVE, nullptr, collect_link, &names));
  std::vector<TimeSeries> found;
  for (const std::string& name : names) {
    const Handle data(H5Dopen2(file, name.c_str(), H5P_DEFAULT), H5Dclose);
    if (data < 0 || name == "t" || name == "y" || name == "w" || name == "x") continue;
    const Handle type(file.checked(H5Dget_type(data)), H5Tclose);
    if (H5Tget_class(type) == H5T_FLOAT && shape_of(file, data) == Shape{hsize_t(rows)})
      found.push_back({name, text_attribute(file, data, "long_name"), column(file, name)});
  }
  return found;
}

Facts attributes(File& file) {
  std::vector<std::string> names;
  file.checked(H5Aiterate2(file, H5_INDEX_NAME, H5_ITER_NATIVE, nullptr, collect_name, &names));
  Facts facts;
  for (const std::string& name : names) {
    const Handle attribute(file.checked(H5Aopen(file, name.c_str(), H5P_DEFAULT)), H5Aclose);
    const Handle type(file.checked(H5Aget_type(attribute)), H5Tclose), space(H5Aget_space(attribute), H5Sclose);
    if (H5Sget_simple_extent_npoints(space) != 1) continue;
    if (H5Tget_class(type) == H5T_STRING) {
      facts.emplace_back(name, text_attribute(file, file, name));
    } else if (H5Tget_class(type) == H5T_FLOAT) {
      double value = 0;
      file.checked(H5Aread(attribute, H5T_NATIVE_DOUBLE, &value));
      facts.emplace_back(name, value);
    } else if (H5Tget_class(type) == H5T_INTEGER) {
      std::int64_t value = 0;
      file.checked(H5Aread(attribute, H5T_NATIVE_INT64, &value));
      facts.emplace_back(name, value);
    }
  }
  return facts;
}

/// rows x (along across) of an array of points over time, the first `rows` of them; no rows if there is none.
RowMatrix points(File& file, const std::string& name, Index rows, Index& across) {
  if (!has(file, "VTKHDF/PointData/" + name)) return {};
  const Handle data = open_dataset(file, file, "VTKHDF/PointData/" + name);
  const Shape shape = shape_to_read(file, data);
  if (shape.size() != 3 || Index(shape[0]) < rows || shape[1] == 0 || shape[2] == 0)
    refuse(file, "has another layout of " + name);
  across = Index(shape[2]);
  const Index all = Index(shape[0]), at_once = Index(shape[1] * shape[2]);
  RowMatrix values(all, at_once);
  if (values.size() > 0) read_all(file, data, H5T_NATIVE_DOUBLE, values.data());
  return values.topRows(rows);
}

/// One value of each constraint: of the first point of its line, or of the last one on the opposite side.
RowMatrix of_constraints(const RowMatrix& values, Index across, Index constraints) {
  if (values.size() == 0) return {};
  const Index along = values.cols() / across;
  RowMatrix found(values.rows(), constraints == 2 * along ? 2 * along : along);
  for (Index i = 0; i < found.cols(); ++i)
    found.col(i) = values.col(i < along ? i * across : (i - along + 1) * across - 1);
  return found;
}

std::vector<std::string> numbered(const char* letter, Index count) {
  std::vector<std::string> names;
  for (Index i = 0; i < count; ++i) names.push_back(letter + std::to_string(i));
  return names;
}

/// The rows that were counted when they were complete.
StoredResult read_image(File& file) {
  StoredResult stored;
  stored.facts = attributes(file);
  Index rows = 0, constraints = 0, across = 1;
  const Handle steps(file.checked(H5Gopen2(file, "VTKHDF/Steps", H5P_DEFAULT)), H5Gclose);
  const Handle count(file.checked(H5Aopen(steps, "NSteps", H5P_DEFAULT)), H5Aclose);
  file.checked(H5Aread(count, H5T_NATIVE_INT64, &rows));
  for (const auto& [name, value] : stored.facts)
    if (const auto* number = std::get_if<std::int64_t>(&value); number && name == "constraints") constraints = *number;
  const Vector t = column(file, "VTKHDF/Steps/Values");
  if (rows < 0 || rows > t.size()) refuse(file, "has fewer times than steps");
  stored.t = t.head(rows);
  const RowMatrix y = points(file, "y", rows, across), w = points(file, "w", rows, across);
  stored.y = of_constraints(y, across, constraints);
  stored.w = of_constraints(w, across, constraints);
  stored.x = points(file, "x", rows, across);
  stored.constraint_names = numbered("y", stored.y.cols());
  stored.state_names = numbered("x", stored.x.cols());
  return stored;
}

}  // namespace

namespace {

bool is_running(const Facts& facts) {
  return std::find(facts.begin(), facts.end(), std::pair<std::string, Fact>("status", "running")) != facts.end();
}

// The last rows of a run that was killed within a flush, whose number the file has and not yet the values: NaN.
void cut_unwritten_rows(StoredResult& stored) {
  const std::array<RowMatrix*, 3> all{&stored.y, &stored.w, &stored.x};
  Index rows = stored.t.size();
  const auto unwritten = [&](Index j) {
    return std::isnan(stored.t[j]) || std::any_of(all.begin(), all.end(), [j](const RowMatrix* values) {
             return values->size() > 0 && values->row(j).array().isNaN().all();
           });
  };
  while (rows > 0 && unwritten(rows - 1)) --rows;
  stored.t.conservativeResize(rows);
  for (RowMatrix* values : all)
    if (values->size() > 0) values->conservativeResize(rows, values->cols());
}

}  // namespace

namespace {

void require_file(const FileTarget& target) {
  if (std::error_code none; !std::filesystem::is_regular_file(target.path, none))
    throw Error(target.argument, "'" + target.path.string() + "' is no file", "give a file that exists");
}

// scenes x (2 components): the last row and the largest size, side by side. Read in parts of few bytes.
RowMatrix last_and_largest(File& file, const std::string& name) {
  constexpr Index values_together = 1 << 22;  // 32 MiB
  const Handle data = open_dataset(file, file, name);
  const Shape shape = shape_to_read(file, data);
  if (shape.size() != 3) refuse(file, "has a dataset " + name + " that is no sweep's");
  const Index scenes = Index(shape[0]), rows = Index(shape[1]), width = Index(shape[2]);
  RowMatrix found(scenes, 2 * width);
  if (rows * width == 0) return RowMatrix(scenes, 0);
  const Index together = std::clamp<Index>(values_together / (rows * width), 1, std::max<Index>(1, scenes));
  RowMatrix part(together * rows, width);
  for (Index first = 0; first < scenes; first += together) {
    const Index count = std::min(together, scenes - first);
    read_rows(file, data, H5T_NATIVE_DOUBLE, first, count, part.data());
    for (Index k = 0; k < count; ++k)
      for (Index c = 0; c < width; ++c) {
        const auto values = part.col(c).segment(k * rows, rows);
        found(first + k, 2 * c) = values[rows - 1];
        found(first + k, 2 * c + 1) = values.cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
      }
  }
  return found;
}

std::vector<std::string> between_blanks(const std::string& text) {
  std::istringstream in(text);
  return {std::istream_iterator<std::string>(in), {}};
}

}  // namespace

std::optional<StoredSweep> read_sweep_hdf5(const FileTarget& target) {
  require_file(target);
  File file(target, File::Access::read);
  if (!has(file, "scene") || !has(file, "y") || !has(file, "status")) return std::nullopt;
  StoredSweep sweep;
  sweep.parameters = between_blanks(text_attribute(file, open_dataset(file, file, "y"), "coordinates"));
  sweep.status = words(file, "status");
  const Index scenes = Index(sweep.status.size());
  sweep.swept.resize(scenes, Index(sweep.parameters.size()));
  for (Index p = 0; p < sweep.swept.cols(); ++p) {
    const Vector values = column(file, sweep.parameters[std::size_t(p)]);
    if (values.size() != scenes)
      refuse(file, "has no value of " + sweep.parameters[std::size_t(p)] + " for each scene");
    sweep.swept.col(p) = values;
  }
  for (const auto& [data, names] : {std::pair("y", "constraint_name"), {"x", "state_name"}}) {
    if (!has(file, data)) continue;
    for (const std::string& name : words(file, names)) {
      sweep.columns.push_back(name + "(T)");
      sweep.columns.push_back("max|" + name + "|");
    }
    const RowMatrix found = last_and_largest(file, data);
    if (found.rows() != scenes) refuse(file, std::string("has no rows of ") + data + " for each scene");
    const Index before = sweep.values.cols();
    sweep.values.conservativeResize(scenes, before + found.cols());
    sweep.values.rightCols(found.cols()) = found;
  }
  return sweep;
}

StoredResult read_hdf5(const FileTarget& target) {
  require_file(target);
  File file(target, File::Access::read);
  if (has(file, "VTKHDF") && has(file, "VTKHDF/Steps")) return read_image(file);
  if (!has(file, "t")) refuse(file, "has no dataset t");
  StoredResult stored;
  stored.t = column(file, "t");
  stored.y = table(file, "y");
  stored.w = table(file, "w");
  stored.x = table(file, "x");
  stored.constraint_names = words(file, "constraint_name");
  stored.state_names = words(file, "state_name");
  stored.t_unit = unit_of(file, "t");
  stored.y_unit = unit_of(file, "y");
  stored.w_unit = unit_of(file, "w");
  stored.x_unit = unit_of(file, "x");
  stored.facts = attributes(file);
  stored.others = others(file, stored.t.size());
  // A run that was killed may have written a block of one array and not yet of the next.
  for (RowMatrix* values : {&stored.y, &stored.w, &stored.x})
    if (values->size() > 0 && values->rows() < stored.t.size()) stored.t.conservativeResize(values->rows());
  for (RowMatrix* values : {&stored.y, &stored.w, &stored.x})
    if (values->rows() > stored.t.size()) values->conservativeResize(stored.t.size(), values->cols());
  if (is_running(stored.facts)) cut_unwritten_rows(stored);
  require_rows(target, stored);
  return stored;
}

}  // namespace bromwich
