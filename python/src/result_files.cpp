// Files of HDF5 for the command of the package: h5py writes and reads them (python/bromwich/_hdf5.py). The wheel has no
// HDF5 of its own, whose libraries would be larger than the rest.

#include "arrays.hpp"
#include "core/base/error.hpp"
#include "files/batched_file.hpp"
#include "files/checkpoint.hpp"
#include "files/stored_result.hpp"
#include "files/sweep_file.hpp"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <memory>
#include <string>
#include <utility>
#include <variant>

namespace bromwich {

namespace {

namespace nb = nanobind;
using namespace nb::literals;
using python::as_matrix;
using python::as_vector;

nb::module_ files() { return nb::module_::import_("bromwich._hdf5"); }

/// What `work` returns, called with the interpreter's lock. An exception of Python becomes an Error of the argument.
template <class Work>
auto in_python(const FileTarget& target, const Work& work) {
  const nb::gil_scoped_acquire lock;
  try {
    return work();
  } catch (nb::python_error& error) {
    const nb::handle value = error.value();
    if (!nb::hasattr(value, "remedy"))
      throw Error(target.argument, "'" + target.path.string() + "' leads to " + nb::cast<std::string>(nb::str(value)),
                  "choose another file", ErrorKind::internal);
    throw Error(target.argument, nb::cast<std::string>(value.attr("found")),
                nb::cast<std::string>(value.attr("remedy")));
  }
}

/// A copy as an array of NumPy.
nb::object array(const Eigen::Ref<const RowMatrix>& values) {
  if (values.size() == 0)
    return nb::module_::import_("numpy").attr("empty")(nb::make_tuple(values.rows(), values.cols()));
  auto copy = std::make_unique<RowMatrix>(values);
  const std::size_t rows = std::size_t(values.rows()), columns = std::size_t(values.cols());
  double* data = copy->data();
  const nb::capsule owner(copy.release(), [](void* p) noexcept { delete static_cast<RowMatrix*>(p); });
  return nb::cast(nb::ndarray<nb::numpy, double>(data, {rows, columns}, owner));
}

nb::object line(const Vector& values) { return array(values.transpose()).attr("ravel")(); }

nb::dict in_dict(const Facts& facts) {
  nb::dict found;
  for (const auto& [name, fact] : facts)
    found[name.c_str()] = std::visit([](const auto& value) { return nb::object(nb::cast(value)); }, fact);
  return found;
}

Facts facts_of(const nb::dict& given) {
  Facts facts;
  for (const auto& [key, value] : given) {
    const std::string name = nb::cast<std::string>(key);
    if (nb::isinstance<nb::str>(value))
      facts.emplace_back(name, nb::cast<std::string>(value));
    else if (nb::isinstance<nb::float_>(value))
      facts.emplace_back(name, nb::cast<double>(value));
    else
      facts.emplace_back(name, nb::cast<std::int64_t>(value));
  }
  return facts;
}

nb::object in_namespace(const ResultColumns& columns) {
  nb::dict units;
  units["t"] = columns.t_unit, units["y"] = columns.y_unit, units["w"] = columns.w_unit, units["x"] = columns.x_unit;
  return nb::module_::import_("types").attr("SimpleNamespace")(
      "constraints"_a = columns.constraints, "slack"_a = columns.slack, "states"_a = columns.states,
      "constraint_names"_a = constraint_names(columns), "state_names"_a = state_names(columns), "units"_a = units);
}

nb::object in_tuple(const FieldGrid& grid) {
  return nb::make_tuple(grid.along, grid.across, grid.along_spacing, grid.across_spacing, grid.along_first,
                        grid.across_first);
}

/// Holds an object of Python, which is closed and freed with the lock.
class Held {
 public:
  explicit Held(nb::object object) : object_(std::move(object)) {}
  ~Held() {
    const nb::gil_scoped_acquire lock;
    try {
      object_.attr("close")();
    } catch (nb::python_error&) {  // what could be written was
    }
    object_.reset();
  }
  Held(const Held&) = delete;
  Held& operator=(const Held&) = delete;
  auto attr(const char* name) const { return object_.attr(name); }

 private:
  nb::object object_;
};

class PythonResult : public BatchedFile {
 public:
  PythonResult(FileTarget target, nb::object file, Index written = 0)
      : target_(std::move(target)),
        chunk_rows_(nb::cast<Index>(file.attr("chunk_rows"))),
        flush_rows_(nb::cast<Index>(file.attr("flush_rows"))),
        file_(std::move(file)) {
    continue_after(written);
  }

  void set(const Facts& facts) override {
    flush();
    in_python(target_, [&] { file_.attr("set")(in_dict(facts)); });
  }

  void add(const std::vector<TimeSeries>& series) override {
    flush();
    in_python(target_, [&] {
      nb::list given;
      for (const TimeSeries& one : series) given.append(nb::make_tuple(one.name, one.meaning, line(one.values)));
      file_.attr("add")(given);
    });
  }

 protected:
  Index chunk_rows() const override { return chunk_rows_; }
  Index flush_rows() const override { return flush_rows_; }

  void write(const ResultRows& rows, Index written) override {
    in_python(target_,
              [&] { file_.attr("write")(line(rows.t), array(rows.y), array(rows.w), array(rows.x), written); });
  }

 private:
  FileTarget target_;
  Index chunk_rows_, flush_rows_;
  Held file_;
};

class PythonSweep : public SweepFile {
 public:
  PythonSweep(FileTarget target, nb::object file) : target_(std::move(target)), file_(std::move(file)) {}

  void append(const SweepRows& rows, const HostThreads&) override {
    in_python(target_, [&] {
      file_.attr("append")(array(rows.parameters), line(rows.residual), array(rows.y), array(rows.w), array(rows.x));
    });
  }

  void finish(const std::vector<std::string>& status, const std::vector<std::string>& reason,
              const std::vector<std::string>& warning, const Facts& facts) override {
    in_python(target_, [&] { file_.attr("finish")(status, reason, warning, in_dict(facts)); });
  }

 private:
  FileTarget target_;
  Held file_;
};

template <class... Arguments>
std::unique_ptr<ResultFile> opened(const FileTarget& target, Index written, const char* function,
                                   const Arguments&... arguments) {
  return in_python(target, [&]() -> std::unique_ptr<ResultFile> {
    return std::make_unique<PythonResult>(target, files().attr(function)(target.path.string(), arguments()...),
                                          written);
  });
}

/// An array of the file; empty if it has none.
RowMatrix table(const nb::dict& found, const char* name) {
  if (!found.contains(name)) return {};
  const nb::object values = nb::module_::import_("numpy").attr("ascontiguousarray")(found[name], "dtype"_a = "float64");
  return as_matrix(nb::cast<python::Array2>(values));
}

Vector column(const nb::handle& values) {
  const nb::object whole = nb::module_::import_("numpy").attr("ascontiguousarray")(values, "dtype"_a = "float64");
  return as_vector(nb::cast<python::Array1>(whole));
}

std::vector<std::string> texts(const nb::dict& found, const char* name) {
  if (!found.contains(name)) return {};
  return nb::cast<std::vector<std::string>>(nb::object(found[name].attr("tolist")()));
}

std::string text(const nb::dict& found, const char* name) {
  return found.contains(name) ? nb::cast<std::string>(found[name]) : std::string();
}

std::vector<std::string> numbered(const char* letter, Index count) {
  std::vector<std::string> names;
  for (Index i = 0; i < count; ++i) names.push_back(letter + std::to_string(i));
  return names;
}

}  // namespace

void require_hdf5(const FileTarget& target) {
  in_python(target, [&] { files().attr("library")(target.path.string()); });
}

std::unique_ptr<ResultFile> create_hdf5(const FileTarget& target, const ResultColumns& columns, Index expected_rows,
                                        const Facts& facts) {
  return opened(
      target, 0, "create_hdf5", [&] { return in_namespace(columns); }, [&] { return expected_rows; },
      [&] { return in_dict(facts); });
}

std::unique_ptr<ResultFile> continue_hdf5(const FileTarget& target, const ResultColumns& columns, Index rows,
                                          const std::string& run) {
  return opened(
      target, rows, "continue_hdf5", [&] { return in_namespace(columns); }, [&] { return rows; }, [&] { return run; });
}

std::unique_ptr<ResultFile> create_vtkhdf(const FileTarget& target, const FieldGrid& grid, const ResultColumns& columns,
                                          Index expected_rows, const Facts& facts) {
  return opened(
      target, 0, "create_vtkhdf", [&] { return in_tuple(grid); }, [&] { return in_namespace(columns); },
      [&] { return expected_rows; }, [&] { return in_dict(facts); });
}

std::unique_ptr<ResultFile> continue_vtkhdf(const FileTarget& target, const FieldGrid& grid,
                                            const ResultColumns& columns, Index rows, const std::string& run) {
  return opened(
      target, rows, "continue_vtkhdf", [&] { return in_tuple(grid); }, [&] { return in_namespace(columns); },
      [&] { return rows; }, [&] { return run; });
}

std::unique_ptr<SweepFile> create_sweep_hdf5(const FileTarget& target, const ResultColumns& columns, const Sweep& sweep,
                                             const Vector& t) {
  return in_python(target, [&]() -> std::unique_ptr<SweepFile> {
    return std::make_unique<PythonSweep>(
        target, files().attr("create_sweep")(target.path.string(), in_namespace(columns), sweep.names, sweep.scenes(),
                                             line(t)));
  });
}

std::optional<StoredSweep> read_sweep_hdf5(const FileTarget& target) {
  return in_python(target, [&]() -> std::optional<StoredSweep> {
    const nb::object file = files().attr("read_sweep")(target.path.string());
    if (file.is_none()) return std::nullopt;
    const nb::dict found = nb::cast<nb::dict>(file);
    const auto words = [&](const char* name) { return nb::cast<std::vector<std::string>>(nb::object(found[name])); };
    return StoredSweep{words("parameters"), words("columns"), words("status"), table(found, "swept"),
                       table(found, "values")};
  });
}

StoredResult read_hdf5(const FileTarget& target) {
  StoredResult stored = in_python(target, [&] {
    const nb::dict found = nb::cast<nb::dict>(files().attr("read")(target.path.string()));
    StoredResult read;
    read.t = column(found["t"]);
    read.y = table(found, "y"), read.w = table(found, "w"), read.x = table(found, "x");
    read.constraint_names = texts(found, "constraint_name"), read.state_names = texts(found, "state_name");
    if (read.constraint_names.empty()) read.constraint_names = numbered("y", read.y.cols());
    if (read.state_names.empty()) read.state_names = numbered("x", read.x.cols());
    const nb::dict units = nb::cast<nb::dict>(found["units"]);
    read.t_unit = text(units, "t"), read.y_unit = text(units, "y");
    read.w_unit = text(units, "w"), read.x_unit = text(units, "x");
    for (const nb::handle one : nb::cast<nb::list>(found["others"]))
      read.others.push_back({nb::cast<std::string>(one[0]), nb::cast<std::string>(one[1]), column(one[2])});
    read.facts = facts_of(nb::cast<nb::dict>(found["facts"]));
    return read;
  });
  require_rows(target, stored);
  return stored;
}

void write_checkpoint(const FileTarget& target, const Checkpoint& c) {
  in_python(target, [&] {
    nb::dict facts;
    facts["run"] = c.run, facts["scene"] = c.scene, facts["t"] = c.t;
    facts["row"] = c.row, facts["steps"] = c.steps;
    files().attr("write_checkpoint")(target.path.string(), facts, in_dict(c.totals), line(c.x), line(c.y));
  });
}

Checkpoint read_checkpoint(const FileTarget& target) {
  return in_python(target, [&] {
    const nb::tuple found = nb::cast<nb::tuple>(files().attr("read_checkpoint")(target.path.string()));
    const nb::dict facts = nb::cast<nb::dict>(found[0]);
    Checkpoint c;
    c.run = nb::cast<std::string>(facts["run"]), c.scene = nb::cast<std::string>(facts["scene"]);
    c.row = nb::cast<Index>(facts["row"]), c.steps = nb::cast<Index>(facts["steps"]),
    c.t = nb::cast<double>(facts["t"]);
    c.totals = facts_of(nb::cast<nb::dict>(found[1]));
    c.x = column(found[2]), c.y = column(found[3]);
    return c;
  });
}

}  // namespace bromwich
