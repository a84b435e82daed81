// Batches of scenes. Matrices and x0 come with a leading axis; results are views of K (J+1) rows.

#include "arrays.hpp"
#include "calls.hpp"
#include "core/batch/batch.hpp"
#include "machine.hpp"
#include "module.hpp"
#include "sources.hpp"

#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <map>
#include <optional>
#include <utility>

namespace bromwich::python {
namespace {

using Array3 = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

struct BatchAnswer {
  BatchResult result;
  std::string backend;
  bool by_keyboard = false;
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
                                        const std::vector<double>& times, const Options& given,
                                        const std::string& backend, int threads, nb::object progress, nb::object stop) {
  Calls calls(std::move(progress), std::move(stop));
  return unlocked(calls, [&] {
    auto answer = std::make_shared<BatchAnswer>();
    Batch batch = batch_from(models, scenes, axes, x0, f, g);
    batch.times = times;
    Options options = given;
    const auto machine = machine_for(backend, models.at(0)->scene, options, threads);
    options.progress = [&](const Progress& p) { calls.progress(p); };
    options.interrupted = [&] { return calls.interrupted(); };
    const std::lock_guard lock(machine->busy);
    answer->backend = machine->backend->name();
    answer->result = solve_batch(batch, *machine->backend, options);
    return answer;
  });
}

template <class Words>
std::vector<std::string> in_words(const Words& all) {
  std::vector<std::string> words;
  for (const auto one : all) words.emplace_back(to_string(one));
  return words;
}

/// "y", "w" or "x": K (J+1) rows.
View rows_of(nb::handle_t<BatchAnswer> self, const std::string& name) {
  const BatchResult& r = nb::cast<BatchAnswer&>(self).result;
  return view(name == "y" ? r.y : name == "w" ? r.w : r.x, self);
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
      .def_prop_ro("status", [](const BatchAnswer& a) { return in_words(a.result.status); })
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
  m.def("solve_batch", &solve_many, nb::arg("models"), nb::arg("scenes"), nb::arg("axes"), nb::arg("x0").none(),
        nb::arg("f"), nb::arg("g"), nb::arg("times"), nb::arg("options"), nb::arg("backend"), nb::arg("threads"),
        nb::arg("progress").none(), nb::arg("stop").none());
}

}  // namespace bromwich::python
