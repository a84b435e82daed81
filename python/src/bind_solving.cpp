// Options, solves and prepared solvers. The interpreter's lock is released while the library computes.

#include "answer.hpp"
#include "arrays.hpp"
#include "calls.hpp"
#include "core/base/error.hpp"
#include "core/result/time_left.hpp"
#include "core/solve/solver.hpp"
#include "ranks.hpp"
#include "sources.hpp"

#include <bromwich/bromwich.hpp>

#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <utility>

namespace bromwich::python {
namespace {

void select_states(Options& options, StateSelection selection, std::vector<Index> components) {
  options.states = selection;
  options.components = std::move(components);
}

Options with_goal(Options options, const Model& model) {
  if (options.method == Method::goal && model.quantity) {
    GoalOptions goal;
    goal.quantity = model.quantity;
    options.goal = std::make_shared<const GoalOptions>(std::move(goal));
  }
  return options;
}

/// Ranks stop together or not at all: they are asked for nothing that one of them could answer otherwise.
std::shared_ptr<Machine> machine_of(const std::shared_ptr<PythonRanks>& ranks, const Wanted& wanted, const Scene& scene,
                                    const Options& options, bool own, bool keeps) {
  if (!ranks) return machine_for(wanted, scene, options, own, keeps);
  check_same(*ranks, scene, options);
  return machine_on_ranks(ranks, wanted, scene, options);
}

std::shared_ptr<Answer> solve_once(std::shared_ptr<const Model> model, const Options& given, const Wanted& wanted,
                                   nb::object progress, nb::object stop, std::shared_ptr<PythonRanks> ranks,
                                   bool reuse) {
  Calls calls(std::move(progress), std::move(stop));
  return unlocked(calls, [&] {
    for (const auto& forget : model->forget) forget();
    Options options = with_goal(given, *model);
    const auto machine = machine_of(ranks, wanted, model->scene, options, false, reuse);
    auto answer = std::make_shared<Answer>(
        Answer{model, machine_of_result(machine, model->scene, options, wanted.threads), options, {}, false, {}});
    options.progress = [&](const Progress& p) { calls.progress(p); };
    if (!ranks) options.interrupted = [&] { return calls.interrupted(); };
    const std::lock_guard lock(machine->busy);
    answer->result =
        reuse ? machine->kept.solve(model->scene, options) : solve(model->scene, *machine->backend, options);
    return answer;
  });
}

/// A Solver, its backend, and the scene as results see it.
class Prepared {
 public:
  Prepared(std::shared_ptr<const Model> model, const Options& given, const Wanted& wanted,
           const std::shared_ptr<PythonRanks>& ranks)
      : seen_(std::move(model)),
        options_(with_goal(given, *seen_)),
        threads_(wanted.threads),
        machine_(machine_of(ranks, wanted, seen_->scene, options_, true, false)),
        solver_(seen_->scene, *machine_->backend, listened(options_)) {}

  void set_x0(const Array1& x0) {
    const nb::gil_scoped_release released;
    const std::lock_guard lock(mutex_);
    solver_.set_x0(as_vector(x0));
    changes_.other_x0 = true;
    seen_ = nullptr;
  }

  void set_sources(const Source* f, const Source* g, const std::vector<double>& declared) {
    const nb::gil_scoped_release released;
    const std::lock_guard lock(mutex_);
    const Source none{{}, 0, {}, true}, &given_f = f ? *f : none, &given_g = g ? *g : none;
    solver_.set_sources(given_f.function, given_g.function,
                        merged(merged(given_f.breakpoints, given_g.breakpoints), declared),
                        given_f.breakpoints_are_all && given_g.breakpoints_are_all);
    changes_.f = f ? std::make_shared<const Source>(*f) : nullptr;
    changes_.g = g ? std::make_shared<const Source>(*g) : nullptr;
    changes_.other_sources = true;
    seen_ = nullptr;
  }

  std::shared_ptr<Answer> solve(nb::object progress, nb::object stop) {
    Calls calls(std::move(progress), std::move(stop));
    return unlocked(calls, [&] {
      const std::lock_guard lock(mutex_);
      const std::lock_guard other(machine_->busy);
      if (!seen_) seen_ = changed();
      if (machine_->ranks) check_same(*machine_->ranks, seen_->scene, options_);
      auto answer = std::make_shared<Answer>(
          Answer{seen_, machine_of_result(machine_, seen_->scene, options_, threads_), options_, {}, false, {}});
      calls_ = &calls;
      const struct Forget {
        Calls*& calls;
        ~Forget() { calls = nullptr; }
      } forget{calls_};
      answer->result = solver_.solve();
      return answer;
    });
  }

 private:
  std::shared_ptr<const Model> changed() const {
    auto model = std::make_shared<Model>(solver_.scene());
    model->f = changes_.f, model->g = changes_.g;
    model->other_x0 = changes_.other_x0, model->other_sources = changes_.other_sources;
    return model;
  }
  Options listened(Options options) {
    options.progress = [this](const Progress& p) {
      if (calls_) calls_->progress(p);
    };
    if (!machine_->ranks) options.interrupted = [this] { return calls_ && calls_->interrupted(); };
    return options;
  }

  std::shared_ptr<const Model> seen_;
  Model changes_;  ///< its sources, and what is another one than at first
  Options options_;
  int threads_;
  std::shared_ptr<Machine> machine_;
  Calls* calls_ = nullptr;  ///< of the solve that runs
  Solver solver_;
  std::mutex mutex_;
};

}  // namespace

void bind_solving(nb::module_& m) {
  nb::class_<Options>(m, "Options")
      .def(nb::init<>())
      .def_prop_rw(
          "method", [](const Options& o) { return to_string(o.method); },
          [](Options& o, const std::string& word) { o.method = method_from_string(word); })
      .def_rw("steps", &Options::steps)
      .def_rw("tolerance", &Options::tolerance)
      .def_rw("tolerance_x", &Options::tolerance_x)
      .def_rw("tolerance_y", &Options::tolerance_y)
      .def_rw("absolute_tolerance", &Options::absolute_tolerance)
      .def_rw("control_states", &Options::control_states)
      .def_rw("max_steps", &Options::max_steps)
      .def_rw("max_seconds", &Options::max_seconds)
      .def_rw("iteration_tolerance", &Options::iteration_tolerance)
      .def_rw("max_iterations", &Options::max_iterations)
      .def_rw("trace", &Options::trace)
      .def_rw("event_location", &Options::event_location)
      .def_rw("confirm", &Options::confirm)
      .def_rw("memory_limit", &Options::memory_limit)
      .def("with_defaults", [](const Options& o, const Model& model) { return with_defaults(o, model.scene); })
      .def("record_no_states", [](Options& o) { select_states(o, StateSelection::none, {}); })
      .def("record_all_states", [](Options& o) { select_states(o, StateSelection::all, {}); })
      .def(
          "record_states",
          [](Options& o, std::vector<Index> components) {
            select_states(o, StateSelection::list, std::move(components));
          },
          nb::arg("components"));
  nb::class_<TimeLeft>(m, "TimeLeft", "An estimate of the seconds that a solve still takes.")
      .def(nb::init<double>(), nb::arg("tolerance"))
      .def(
          "after",
          [](TimeLeft& left, Index done, Index total, double change, double seconds) {
            return left.after({done, change, total}, seconds);
          },
          nb::arg("done"), nb::arg("total"), nb::arg("change"), nb::arg("seconds"));
  nb::class_<Wanted>(m, "Wanted", "What a solve is asked to run on.")
      .def(
          "__init__",
          [](Wanted* wanted, std::string backend, std::optional<int> device, int number_here, int threads) {
            new (wanted) Wanted{std::move(backend), device, number_here, threads};
          },
          nb::arg("backend"), nb::arg("device").none(), nb::arg("number_here"), nb::arg("threads"));
  m.def("solve", &solve_once, nb::arg("model"), nb::arg("options"), nb::arg("wanted"), nb::arg("progress").none(),
        nb::arg("stop").none(), nb::arg("ranks").none(), nb::arg("reuse"));
  nb::class_<Prepared>(m, "Prepared")
      .def(nb::init<std::shared_ptr<const Model>, const Options&, const Wanted&, const std::shared_ptr<PythonRanks>&>(),
           nb::arg("model"), nb::arg("options"), nb::arg("wanted"), nb::arg("ranks").none())
      .def("set_x0", &Prepared::set_x0, nb::arg("x0"))
      .def("set_sources", &Prepared::set_sources, nb::arg("f").none(), nb::arg("g").none(), nb::arg("breakpoints"))
      .def("solve", &Prepared::solve, nb::arg("progress").none(), nb::arg("stop").none());
  m.attr("version") = BROMWICH_VERSION;
}

}  // namespace bromwich::python
