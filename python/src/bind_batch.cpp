// Batches of scenes. Matrices and x0 come with a leading axis; results are views of K (J+1) rows.

#include "app/backend_choice.hpp"
#include "arrays.hpp"
#include "batch/batch.hpp"
#include "batch/batch_arrays.hpp"
#include "batch/batch_derivative.hpp"
#include "batch/batch_parameters.hpp"
#include "batch/stopped_batch.hpp"
#include "calls.hpp"
#include "cpu/cpu_backend.hpp"
#include "machine.hpp"
#include "module.hpp"
#include "shared_arrays.hpp"
#include "sources.hpp"

#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

namespace bromwich::python {
namespace {

using Array3 = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

struct BatchAnswer {
  std::shared_ptr<const Batch> batch;
  std::shared_ptr<Machine> machine;
  BatchResult result;
  std::string backend;
  bool by_keyboard = false;
  std::shared_ptr<double> y, x;  ///< of results that stay on the backend, for other libraries

  ~BatchAnswer() {  // memory before the backend
    if (!result.arrays) return;
    const nb::gil_scoped_release released;
    const std::lock_guard lock(machine->busy);
    y.reset(), x.reset(), result.arrays.reset();
  }
};

std::vector<Matrix> matrices(const Array3& all) {
  std::vector<Matrix> found;
  const Index rows = Index(all.shape(1)), cols = Index(all.shape(2));
  for (std::size_t k = 0; k < all.shape(0); ++k)
    found.push_back(Eigen::Map<const RowMatrix>(all.data() + Index(k) * rows * cols, rows, cols));
  return found;
}

std::vector<TimeFunction> functions(const std::vector<const Source*>& sources) {
  std::vector<TimeFunction> found;
  for (const Source* source : sources) found.push_back(source ? source->function : TimeFunction());
  return found;
}

bool calls_of(const std::vector<const Source*>& sources) {
  return std::any_of(sources.begin(), sources.end(), [](const Source* s) { return s && !s->callables.empty(); });
}

Batch batch_from(const std::vector<std::shared_ptr<const Model>>& models, Index scenes,
                 const std::map<std::string, Array3>& axes, const std::optional<Array2>& x0,
                 const std::vector<const Source*>& f, const std::vector<const Source*>& g) {
  for (const auto& model : models)
    for (const auto& forget : model->forget) forget();
  if (models.size() > 1 || scenes == 0) {
    std::vector<Scene> list;
    for (const auto& model : models) list.push_back(model->scene);
    return batch_of(std::move(list));
  }
  Batch batch;
  batch.common = models.at(0)->scene;
  batch.scenes = scenes;
  for (const auto& [name, member] :
       {std::pair("A", &batch.A), {"B", &batch.B}, {"N", &batch.N}, {"M", &batch.M}, {"E", &batch.E}})
    if (const auto found = axes.find(name); found != axes.end()) *member = matrices(found->second);
  if (x0) batch.x0 = as_matrix(*x0);
  batch.f = functions(f), batch.g = functions(g);
  const auto all = [](const std::vector<const Source*>& own) {
    return std::all_of(own.begin(), own.end(), [](const Source* s) { return s && s->breakpoints_are_all; });
  };
  batch.breakpoints_are_all = all(f) && all(g) && batch.common.breakpoints_are_all;
  if (!f.empty() || !g.empty())
    for (Index k = 0; k < scenes; ++k) {
      const Model& common = *models.at(0);
      const auto times = [&](const std::vector<const Source*>& own, const std::shared_ptr<const Source>& shared) {
        const Source* source = own.empty() ? shared.get() : own[std::size_t(k)];
        return source ? source->breakpoints : std::vector<double>();
      };
      batch.breakpoints.push_back(merged(merged(times(f, common.f), times(g, common.g)), common.declared));
    }
  return batch;
}

std::shared_ptr<BatchAnswer> solve_many(const std::vector<std::shared_ptr<const Model>>& models, Index scenes,
                                        const std::map<std::string, Array3>& axes, const std::optional<Array2>& x0,
                                        const std::vector<const Source*>& f, const std::vector<const Source*>& g,
                                        const std::vector<double>& times, bool keep_on_backend, const Options& given,
                                        const Wanted& wanted, nb::object progress, nb::object stop) {
  Calls calls(std::move(progress), std::move(stop));
  return unlocked(calls, [&] {
    auto answer = std::make_shared<BatchAnswer>();
    Batch batch = batch_from(models, scenes, axes, x0, f, g);
    batch.times = times;
    batch.keep_on_backend = keep_on_backend;
    Options options = given;
    const auto machine = machine_for(wanted, models.at(0)->scene, options);
    options.progress = [&](const Progress& p) { calls.progress(p); };
    options.interrupted = [&] { return calls.interrupted(); };
    const std::lock_guard lock(machine->busy);
    answer->backend = machine->backend->name();
    answer->machine = machine;
    // Functions of Python are called by this thread alone.
    const bool calls_python =
        std::any_of(models.begin(), models.end(), [](const auto& m) { return !m->callables.empty(); }) || calls_of(f) ||
        calls_of(g);
    if (!machine->beside) machine->beside = app::backends_beside(*machine->backend, machine->device);
    answer->result =
        solve_batch_until_stopped(batch, *machine->backend, options, calls_python ? MakeBackend() : machine->beside);
    answer->batch = std::make_shared<const Batch>(std::move(batch));
    return answer;
  });
}

template <class Words>
std::vector<std::string> in_words(const Words& all) {
  std::vector<std::string> words;
  for (const auto one : all) words.emplace_back(to_string(one));
  return words;
}

/// "y", "w" or "x": K (J+1) rows. Those that a stopped call did not reach are made here.
View rows_of(nb::handle_t<BatchAnswer> self, const std::string& name) {
  BatchAnswer& answer = nb::cast<BatchAnswer&>(self);
  BatchResult& r = answer.result;
  add_missing_rows(r);
  if (name == "w" && !r.w_is_due.empty()) {
    const nb::gil_scoped_release released;
    const std::lock_guard lock(answer.machine->busy);
    add_rows_of_w(*answer.batch, *answer.machine->backend, r);
  }
  return view(name == "y" ? r.y : name == "w" ? r.w : r.x, self);
}

const Array& array_of(const BatchAnswer& answer, const std::string& name) {
  return name == "y" ? answer.result.arrays->y() : *answer.result.arrays->x();
}

/// "y" or "x" of results that stay on the backend, row by row.
double* numbers_of(BatchAnswer& answer, const std::string& name) {
  std::shared_ptr<double>& numbers = name == "y" ? answer.y : answer.x;
  if (numbers) return numbers.get();
  const nb::gil_scoped_release released;
  const std::lock_guard lock(answer.machine->busy);
  SharedMemory& memory = shared(*answer.machine);
  const Array& all = array_of(answer, name);
  numbers = memory.numbers(all.rows() * all.cols());
  memory.write(all, numbers.get());
  answer.machine->backend->wait();
  return numbers.get();
}

/// The same by DLPack, K x rows x columns.
nb::ndarray<double> table_of(const std::shared_ptr<BatchAnswer>& answer, const std::string& name) {
  const BatchResult& r = answer->result;
  return python::handed_over(answer, numbers_of(*answer, name), {r.scenes, r.rows(), array_of(*answer, name).cols()},
                             shared(*answer->machine).place());
}

using Tables = std::map<std::string, Array3>;

/// One table of every scene under each other, owned by NumPy.
template <class Table>
nb::object stacked(const std::vector<Table>& tables) {
  const Index rows = tables[0].rows(), cols = tables[0].cols();
  auto* all = new RowMatrix(Index(tables.size()) * rows, cols);
  const nb::capsule owner(all, [](void* p) noexcept { delete static_cast<RowMatrix*>(p); });
  for (std::size_t k = 0; k < tables.size(); ++k)
    if (tables[k].size() > 0)
      all->middleRows(Index(k) * rows, rows) = tables[k];
    else
      all->middleRows(Index(k) * rows, rows).setConstant(NAN);
  return nb::cast(view(*all, owner));
}

template <class Value, class Table>
nb::object member(const std::vector<Value>& values, Table Value::*table) {
  std::vector<Table> tables;
  Index rows = 0, cols = 0;
  for (const Value& value : values) {
    tables.push_back(value.*table);
    rows = std::max(rows, Index(tables.back().rows())), cols = std::max(cols, Index(tables.back().cols()));
  }
  if (rows * cols == 0) return nb::none();
  for (Table& one : tables)
    if (one.size() == 0) one = Table::Constant(rows, cols, NAN);
  return stacked(tables);
}

/// With the backend of the result, which is used by one caller at a time.
class EachDerivative {
 public:
  EachDerivative(const BatchAnswer& answer, std::optional<bool> located)
      : machine_(answer.machine), derivative_(made(answer, located)) {}
  ~EachDerivative() {  // arrays before the backend
    const auto lock = locked();
    derivative_.reset();
  }
  EachDerivative(const EachDerivative&) = delete;
  EachDerivative& operator=(const EachDerivative&) = delete;

  const BatchDerivative& operator*() const { return *derivative_; }
  const BatchDerivative* operator->() const { return &*derivative_; }
  std::unique_lock<std::mutex> locked() const {
    if (!machine_ || derivative_->side_by_side() == 0) return {};
    const nb::gil_scoped_release released;  // whoever has it may need the interpreter
    return std::unique_lock(machine_->busy);
  }

 private:
  static std::unique_ptr<BatchDerivative> made(const BatchAnswer& answer, std::optional<bool> located) {
    return interruptible([&] {
      Backend* backend = answer.machine ? answer.machine->backend.get() : nullptr;
      if (backend && !steps_many_scenes(*backend)) backend = nullptr;
      const auto lock = backend ? std::unique_lock(answer.machine->busy) : std::unique_lock<std::mutex>();
      return std::make_unique<BatchDerivative>(*answer.batch, answer.result, located, backend);
    });
  }

  std::shared_ptr<Machine> machine_;
  std::unique_ptr<BatchDerivative> derivative_;
};

/// (y, x, w, integral, reasons): tables of K (J+1) rows.
nb::tuple forward_each(const EachDerivative& d, const Tables& given, int threads) {
  std::vector<DataChange> changes{std::size_t(d->scenes())};
  for (std::size_t k = 0; k < changes.size(); ++k) {
    DataChange& c = changes[k];
    const auto take = [&](const char* name, auto& to) {
      const auto found = given.find(name);
      if (found == given.end()) return;
      const Index rows = Index(found->second.shape(1)), cols = Index(found->second.shape(2));
      to = Eigen::Map<const RowMatrix>(found->second.data() + Index(k) * rows * cols, rows, cols);
    };
    RowMatrix x0, restitution;
    take("x0", x0), take("restitution", restitution), take("f", c.f), take("g", c.g);
    take("A", c.A), take("B", c.B), take("N", c.N), take("M", c.M), take("E", c.E);
    c.x0 = x0.transpose().reshaped(), c.restitution = restitution.transpose().reshaped();
  }
  const auto backend = make_cpu_backend(threads);
  const auto lock = d.locked();
  const PerScene<SolutionChange> out = d->jvp(changes, *backend);
  return nb::make_tuple(member(out.value, &SolutionChange::y), member(out.value, &SolutionChange::x),
                        member(out.value, &SolutionChange::w), member(out.value, &SolutionChange::integral),
                        out.reason);
}

/// (x0, f, g, A, B, N, M, E, restitution, reasons).
nb::tuple backward_each(const EachDerivative& d, const Tables& given, int threads) {
  std::vector<SolutionChange> functions{std::size_t(d->scenes())};
  for (std::size_t k = 0; k < functions.size(); ++k)
    for (const auto& [name, table] : {std::pair("y", &SolutionChange::y),
                                      {"x", &SolutionChange::x},
                                      {"w", &SolutionChange::w},
                                      {"integral", &SolutionChange::integral}})
      if (const auto found = given.find(name); found != given.end()) {
        const Index rows = Index(found->second.shape(1)), cols = Index(found->second.shape(2));
        functions[k].*table = Eigen::Map<const RowMatrix>(found->second.data() + Index(k) * rows * cols, rows, cols);
      }
  const auto backend = make_cpu_backend(threads);
  const auto lock = d.locked();
  const PerScene<DataChange> out = d->vjp(functions, *backend);
  return nb::make_tuple(member(out.value, &DataChange::x0), member(out.value, &DataChange::f),
                        member(out.value, &DataChange::g), member(out.value, &DataChange::A),
                        member(out.value, &DataChange::B), member(out.value, &DataChange::N),
                        member(out.value, &DataChange::M), member(out.value, &DataChange::E),
                        member(out.value, &DataChange::restitution), out.reason);
}

nb::list margins(const std::vector<DerivativeMargin>& of_scenes) {
  nb::list all;
  for (const DerivativeMargin& at : of_scenes)
    all.append(nb::make_tuple(at.margin, at.time, at.constraint, at.transversality, at.grazing_time));
  return all;
}

/// By parameters: (tables of each, reasons, margins). `values`: of each scene in turn; `scene_of`: (values of a scene)
/// to a model.
nb::tuple jacobian_of_each(BatchAnswer& answer, const std::vector<std::string>& names, const Array2& values,
                           const nb::callable& scene_of, std::optional<bool> located, int threads) {
  add_missing_rows(answer.result);
  const RowMatrix given = as_matrix(values);
  const auto scene_at = [&scene_of](const Vector& at) {
    const nb::gil_scoped_acquire held;
    try {
      const auto model = nb::cast<std::shared_ptr<Model>>(scene_of(std::vector<double>(at.begin(), at.end())));
      return ParameterScene{model->scene, nullptr};
    } catch (const nb::python_error& raised) {  // there is no scene with these values
      if (!raised.matches(nb::module_::import_("bromwich").attr("Error"))) throw;
      throw Error("scene_of", nb::str(raised.value()).c_str(), "return a scene for these values");
    }
  };
  const auto parameters = [&](Index k) {
    std::vector<VariedParameter> all;
    for (Index p = 0; p < Index(names.size()); ++p)
      all.push_back({names[std::size_t(p)], given(k, p), [&, k, p](double value) {
                       Vector at = given.row(k).transpose();
                       at[p] = value;
                       return scene_at(at);
                     }});
    return all;
  };
  const auto backend = make_cpu_backend(threads);
  const BatchJacobian found =
      interruptible([&] { return jacobian_of(*answer.batch, answer.result, parameters, *backend, located, *backend); });
  nb::list by;
  for (const std::vector<SolutionChange>& one : found.by)
    by.append(nb::make_tuple(member(one, &SolutionChange::y), member(one, &SolutionChange::x),
                             member(one, &SolutionChange::w), member(one, &SolutionChange::integral)));
  return nb::make_tuple(by, found.reason, margins(found.margin));
}

}  // namespace

void bind_batch(nb::module_& m) {
  nb::class_<BatchAnswer>(m, "BatchAnswer", "Results of many scenes.")
      .def_prop_ro("scenes", [](const BatchAnswer& a) { return a.result.scenes; })
      .def_prop_ro("t",
                   [](nb::handle_t<BatchAnswer> self) { return view(nb::cast<BatchAnswer&>(self).result.t, self); })
      .def_prop_ro(
          "residual",
          [](nb::handle_t<BatchAnswer> self) { return view(nb::cast<BatchAnswer&>(self).result.residual, self); })
      .def("rows", &rows_of, nb::arg("name"))
      .def_prop_ro("columns_on_backend",
                   [](const BatchAnswer& a) -> std::optional<std::pair<Index, Index>> {
                     if (!a.result.arrays) return std::nullopt;
                     return std::pair(a.result.arrays->y().cols(),
                                      a.result.arrays->x() ? a.result.arrays->x()->cols() : 0);
                   })
      .def_prop_ro("place",
                   [](const BatchAnswer& a) {
                     const SharedMemory::Place place = shared(*a.machine).place();
                     return std::pair(place.kind, place.number);
                   })
      .def("capsule", &table_of, nb::arg("name"))
      .def(
          "address",
          [](BatchAnswer& a, const std::string& name) { return reinterpret_cast<std::uintptr_t>(numbers_of(a, name)); },
          nb::arg("name"))
      .def_prop_ro("status", [](const BatchAnswer& a) { return in_words(a.result.status); })
      .def_prop_ro("solved",
                   [](const BatchAnswer& a) {
                     std::string solved;  // a byte each
                     for (const Status status : a.result.status) solved += char(status == Status::solved);
                     const nb::bytes bytes(solved.data(), solved.size());
                     return nb::module_::import_("numpy").attr("frombuffer")(bytes, "bool");
                   })
      .def_prop_ro("method", [](const BatchAnswer& a) { return in_words(a.result.method); })
      .def_prop_ro("reason", [](const BatchAnswer& a) { return a.result.reason; })
      .def_prop_ro("warning", [](const BatchAnswer& a) { return a.result.warning; })
      .def_prop_ro("infeasible_at", [](const BatchAnswer& a) { return a.result.infeasible_at; })
      .def_prop_ro("x_components", [](const BatchAnswer& a) { return a.result.x_components; })
      .def_prop_ro("in_lanes", [](const BatchAnswer& a) { return a.result.in_lanes; })
      .def_prop_ro("prepared", [](const BatchAnswer& a) { return a.result.prepared; })
      .def_prop_ro("seconds", [](const BatchAnswer& a) { return a.result.seconds; })
      .def_prop_ro("backend", [](const BatchAnswer& a) { return a.backend; })
      .def_ro("by_keyboard", &BatchAnswer::by_keyboard);
  nb::class_<EachDerivative>(m, "BatchDerivative")
      .def(
          "__init__",
          [](EachDerivative* self, BatchAnswer& answer, std::optional<bool> located) {
            add_missing_rows(answer.result);
            new (self) EachDerivative(answer, located);
          },
          nb::arg("answer"), nb::arg("located").none())
      .def_prop_ro("reason", [](const EachDerivative& d) { return d->reason(); })
      .def_prop_ro("located", [](const EachDerivative& d) { return d->located(); })
      .def_prop_ro("side_by_side", [](const EachDerivative& d) { return d->side_by_side(); })
      .def_prop_ro("margin", [](const EachDerivative& d) { return margins(d->margin()); })
      .def("jvp", &forward_each, nb::arg("tables"), nb::arg("threads"))
      .def("vjp", &backward_each, nb::arg("tables"), nb::arg("threads"));
  m.def("batch_jacobian", &jacobian_of_each, nb::arg("answer"), nb::arg("names"), nb::arg("values"),
        nb::arg("scene_of"), nb::arg("located").none(), nb::arg("threads"));
  m.def("solve_batch", &solve_many, nb::arg("models"), nb::arg("scenes"), nb::arg("axes"), nb::arg("x0").none(),
        nb::arg("f"), nb::arg("g"), nb::arg("times"), nb::arg("keep_on_backend"), nb::arg("options"), nb::arg("wanted"),
        nb::arg("progress").none(), nb::arg("stop").none());
}

}  // namespace bromwich::python
