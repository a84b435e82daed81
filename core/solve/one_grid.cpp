#include "core/solve/one_grid.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/dual/local_march.hpp"
#include "core/iteration/windows.hpp"
#include "core/lcp/same_matrix.hpp"
#include "core/solve/certification.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/method_choice.hpp"
#include "core/solve/methods.hpp"
#include "core/solve/prepared.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

namespace bromwich {

namespace {

// One run of a scene: its methods on the requested grid, and on finer ones if a result has to be confirmed.
class Run {
 public:
  Run(Methods& methods, Backend& backend, const InnerOptions& options)
      : methods_(methods), backend_(backend), options_(options), certification_(methods, backend, options) {}

  void named(Method method, Result& result) {
    const DiscreteProblem& p = methods_.problem();
    note(options_.log, level(), "method %s: %ld steps of %.6g", to_string(method), long(p.J), p.h);
    methods_.run(method, options_, result);
    note(options_.log, LogLevel::debug, "method %s: %s after %.3g s of set-up; %s", to_string(method),
         to_string(result.status), result.seconds.setup, result.kernel.c_str());
    Timer timer;
    certify(method, result);
    result.seconds.certification += timer.lap();
  }

  void certify(Method method, Result& result) {
    if (iterates(method) && result.infeasible_at && result.status == Status::tolerance_not_met)
      confirm_by_marching(result);
    else if (iterates(method) && result.status != Status::infeasible)
      result.infeasible_at.reset();
    if (result.status == Status::infeasible && result.infeasible_at.value_or(0) > 0)
      certification_.confirm_infeasible(result);
    if (result.status == Status::solved) certification_.certify(method, result);
    if (result.status == Status::solved && !result.certificate) methods_.tell_sources(result);
  }

  // Tries the methods in the order of their predicted times, after those that are faster where they serve. If one does
  // not fit into memory or ends without a solution (in marching M + W_0 may leave the class of M; the iteration needs M
  // only), the next one follows, and implicit Euler last. Euler is not tried if the steps are too long for a better
  // method: it is less accurate on the same grid.
  void automatic(Result& result) {
    const DiscreteProblem& p = methods_.problem();
    for (const EarlyMethod& early : early_methods())
      if (run_early(early, result)) return;
    const std::vector<Method> methods = methods_by_time(backend_.traits(), p.scene, p.lcp_class, p.J);
    note(options_.log, level(), "auto tries %s", listed(methods).c_str());
    std::string before;
    for (const Method method : methods) {
      if (method == Method::euler && !options_.fall_back_to_euler) {
        if (result.reason.empty()) result.reason = "no method of second order applies" + before;
        return;
      }
      std::string why = against(method);
      if (why.empty()) {
        if (run_in_turn(method, before, result) || certification_.sensitive()) return;
        why = last_reason_;
      }
      before += std::string("; not ") + to_string(method) + ": " + why;
      note(options_.log, LogLevel::info, "not %s: %s", to_string(method), why.c_str());
    }
  }

 private:
  // Of several grids their errors are logged, and not how each was solved.
  LogLevel level() const { return options_.compares_grids ? LogLevel::debug : LogLevel::info; }

  static std::string listed(const std::vector<Method>& methods) {
    std::string words;
    for (const Method method : methods) words += (words.empty() ? "" : ", then ") + std::string(to_string(method));
    return words;
  }

  // True if its result is that of the solve. Of several failures the first is the one to explain.
  bool run_in_turn(Method method, const std::string& before, Result& result) {
    Result next;
    next.seconds.setup = result.seconds.setup;
    if (method == Method::euler && !result.reason.empty()) certification_.expect_last_resort(result.well_posed);
    named(method, next);
    // Implicit Euler, the last resort, is too inexact to prove that there is no solution where the others did not.
    const bool ended = next.status != Status::tolerance_not_met && next.status != Status::unsupported &&
                       (method != Method::euler || next.status != Status::infeasible);
    last_reason_ = next.reason;
    if (!ended && !result.reason.empty()) return false;
    result = std::move(next);
    if (ended) result.kernel += before;
    return ended;
  }

  // A method that is faster than those of methods_by_time where it serves.
  struct EarlyMethod {
    Method method;
    bool wanted;
    Index most_iterations;
    bool (*serves)(const Result&);
    const char* words;
  };

  std::vector<EarlyMethod> early_methods() {
    const auto is_decided = [](const Result& r) {
      return r.status == Status::solved || r.status == Status::infeasible;
    };
    // Only with the stages that march has, and only a solution that passes all checks.
    const auto has_stages = [](const Result& r) {
      return (r.status == Status::solved && !r.continuous) || r.status == Status::interrupted;
    };
    return {{Method::contour, pays_in_sweeps(), affordable_sweeps(), is_decided,
             "; taken before march, whose n x n problems cost more"},
            {Method::dual, pays_in_w() && against(Method::dual).empty(), options_.max_iterations, has_stages,
             "; taken before march"}};
  }

  bool run_early(const EarlyMethod& early, Result& result) {
    if (!early.wanted) return false;
    InnerOptions limited = options_;
    limited.max_iterations = early.most_iterations;
    Result first;
    first.seconds.setup = result.seconds.setup;
    Run(methods_, backend_, limited).named(early.method, first);
    if (!early.serves(first)) {
      note(options_.log, LogLevel::info, "not %s: %s", to_string(early.method),
           first.status == Status::solved ? "its order is 1" : first.reason.c_str());
      return false;
    }
    result = std::move(first);
    result.kernel += early.words;
    return true;
  }

  // Above this many constraints the n x n problems of marching cost more than many sweeps.
  bool pays_in_sweeps() const {
    const DiscreteProblem& p = methods_.problem();
    return backend_.traits().one_at_a_time && p.face().size() == 1 && p.scene.constraints() > largest_marched;
  }
  static constexpr Index largest_marched = 1024;

  // As many as marching is predicted to cost.
  Index affordable_sweeps() const {
    const DiscreteProblem& p = methods_.problem();
    const double march = predicted_cost(p.scene, Method::march, p.J, 0).operations;
    const double sweep = predicted_cost(p.scene, Method::contour, p.J, 0).operations / 100;
    return std::clamp<Index>(Index(march / sweep), 1, options_.max_iterations);
  }

  // In w a local V is marched with the sparse matrix of many states, where marching in y has a full one. On a device
  // the cycles of a Kronecker sum are faster than marching on its host.
  bool pays_in_w() {
    const DiscreteProblem& p = methods_.problem();
    if (p.scene.dynamics->matrices()) return has_local_inverse(p);
    return !backend_.traits().one_at_a_time && p.modes() && methods_.basis().rings &&
           double(p.J) * double(p.scene.constraints()) >= fewest_cycled;
  }
  static constexpr double fewest_cycled = 1e6;  ///< n J

  // The reason not to run a method, known in advance; empty: none.
  std::string against(Method method) {
    const DiscreteProblem& p = methods_.problem();
    const DeviceInfo device = backend_.device();
    const Cost cost = predicted_cost(p.scene, method, p.J, Index(p.components.size()), device.threads);
    if (options_.memory_limit > 0 && cost.bytes > options_.memory_limit) return "it does not fit into memory";
    if (!fits_on_device(p.scene, method, p.J, Index(p.components.size()), device))
      return "it does not fit into the memory of the device";
    if (method != Method::contour || selects_least(p.lcp_class)) return "";
    const std::optional<Forecast> f = iteration_forecast(p, options_.iteration_tolerance);
    if (f && f->longest_window(options_.iteration_tolerance) == 0)
      return text("its sweeps are not known to contract (kappa_0 = %.2g)", f->kappa0);
    return "";
  }

  // An infeasible iterate proves nothing about the scene; marching the same discretisation decides.
  void confirm_by_marching(Result& result) {
    const std::string observed = result.reason;
    note(options_.log, LogLevel::info, "%s: confirmed by marching", observed.c_str());
    Result marched;
    methods_.run(Method::march, options_, marched);
    result.infeasible_at.reset();
    if (marched.status == Status::infeasible) {
      result.status = Status::infeasible;
      result.reason = marched.reason + " (confirmed by marching)";
      result.infeasible_at = marched.infeasible_at;
      result.y = std::move(marched.y);
      result.x = std::move(marched.x);
      result.trace = std::move(marched.trace);
      result.residual = marched.residual;
    } else if (marched.status == Status::solved) {
      result.reason = observed + ", but marching gets past it: use method march";
    } else {
      result.reason = observed + "; marching ends too: " + marched.reason;
    }
  }

  Methods& methods_;
  Backend& backend_;
  const InnerOptions& options_;
  Certification certification_;
  std::string last_reason_;
};

bool finite_sources(const DiscreteProblem& p, Result& result) {
  for (const auto& [values, name] : {std::pair(&p.f, "f"), std::pair(&p.g, "g")}) {
    const Index j = values->not_finite();
    if (j < 0) continue;
    result.status = Status::nonfinite;
    result.reason = std::string(name) + " is not finite at t = " + std::to_string(p.t[j]);
    return false;
  }
  return true;
}

// How f enters: reductions of the scene derive that from which sources there are.
bool same_entry(const Scene& a, const Scene& b) { return a.f_entry == b.f_entry && same(a.F, b.F); }

// The grid that a Solver keeps for these steps, if its methods are for this scene; a new one in its place otherwise.
PreparedGrid& kept_grid(const Scene& scene, Index J, const std::vector<Index>& components,
                        const InnerOptions& options) {
  Prepared& prepared = *options.prepared;
  PreparedGrid& grid = prepared.grids[J];
  const bool as_stated = &scene == prepared.stated;
  const bool fits = grid.methods && grid.methods->problem().components == components &&
                    grid.methods->looks_inside_every_step() == options.look_inside_every_step &&
                    (as_stated ? !grid.scene : grid.scene && same_entry(*grid.scene, scene));
  if (!fits) grid = {};
  return grid;
}

// The methods of the solve before, with the x0, f and g of this one. A Solver changes nothing else; what it has changed
// of the scene as stated has changed in the scenes that are made from it.
Methods& prepared_methods(const Scene& scene, Backend& backend, Index J, const std::vector<Index>& components,
                          const InnerOptions& options, PreparedGrid& grid) {
  if (grid.methods) {
    if (grid.scene) {
      grid.scene->x0 = scene.x0;
      grid.scene->f = scene.f;
      grid.scene->g = scene.g;
      grid.scene->breakpoints = scene.breakpoints;
      grid.scene->breakpoints_are_all = scene.breakpoints_are_all;
      grid.scene->no_pulses = scene.no_pulses;
    }
    grid.finite_sources = grid.finite_sources && !grid.changes.sources;
    grid.methods->renew(grid.changes);
  } else {
    if (&scene != options.prepared->stated) grid.scene = std::make_unique<Scene>(scene);
    grid.methods = std::make_unique<Methods>(grid.scene ? *grid.scene : scene, backend, J, components,
                                             options.look_inside_every_step, options.family);
    grid.methods->keep_prepared();
  }
  grid.changes = no_changes;
  return *grid.methods;
}

// The largest grids stay where all together exceed the limit.
void forget_what_does_not_fit(Prepared& prepared, Index J, double limit) {
  if (limit <= 0) return;
  double bytes = 0;
  for (const auto& [steps, grid] : prepared.grids) bytes += grid.cost.bytes;
  for (auto grid = prepared.grids.begin(); grid != prepared.grids.end() && bytes > limit;) {
    const bool other = grid->first != J;
    if (other) bytes -= grid->second.cost.bytes;
    grid = other ? prepared.grids.erase(grid) : std::next(grid);
  }
}

}  // namespace

Result solve_on_one_grid(const Scene& scene, Backend& backend, const InnerOptions& options) {
  Timer total;
  Result result;
  result.method = options.method;
  const Index J = steps_of(scene, options);
  if (const RowMatrix* y = options.tuning.first_iterate; y && (y->rows() != J + 1 || y->cols() != scene.constraints()))
    throw Error("first_iterate", "found " + std::to_string(y->rows()) + " x " + std::to_string(y->cols()),
                "give one row per time point and one column per constraint");
  const std::vector<Index> components = recorded_components(scene, options);
  // The cost of methods that there are is not asked for again: a device takes a while to say what it has free.
  PreparedGrid* const kept =
      options.prepared && options.prepared->stated ? &kept_grid(scene, J, components, options) : nullptr;
  const Cost cost = kept && kept->methods && !kept->changes.sources
                        ? kept->cost
                        : refuse_what_does_not_fit(scene, options, J, Index(components.size()), backend.device());
  if (kept) {
    kept->cost = cost;
    forget_what_does_not_fit(*options.prepared, J, options.memory_limit);
  }
  const std::unique_ptr<Methods> once =
      kept ? nullptr
           : std::make_unique<Methods>(scene, backend, J, components, options.look_inside_every_step, options.family);
  Methods& methods = once ? *once : prepared_methods(scene, backend, J, components, options, *kept);
  const DiscreteProblem& p = methods.problem();
  note(options.log, LogLevel::debug, "M is of class %s, %ld constraints, %ld states", to_string(p.lcp_class),
       long(scene.constraints()), long(scene.states()));
  const bool finite = (kept && kept->finite_sources) || finite_sources(p, result);
  if (kept) kept->finite_sources = finite;
  result.seconds.setup = Timer(total).lap();
  if (finite) {
    Run run(methods, backend, options);
    if (options.method == Method::automatic)
      run.automatic(result);
    else
      run.named(options.method, result);
  }
  result.backend = backend.name();
  result.bytes_predicted = std::size_t(cost.bytes);
  result.t = p.t;
  result.steps = J;
  if (result.y.size() == 0) result.y = RowMatrix::Constant(J + 1, scene.constraints(), NAN);
  if (options.trace && result.trace.rows() != J + 1)
    result.trace = RowMatrix::Constant(J + 1, scene.constraints(), NAN);
  if (result.x.rows() != J + 1) result.x = RowMatrix::Constant(J + 1, Index(components.size()), NAN);
  if (result.status == Status::infeasible && result.infeasible_at == 0.0) result.y.setConstant(NAN);
  for (Index j = 0; j < result.trace.rows(); ++j)  // rows without y have no trace
    if (!result.y.row(j).allFinite()) result.trace.row(j).setConstant(NAN);
  result.x_components = components;
  Seconds& s = result.seconds;
  s.total = total.lap();
  s.solve = s.total - s.setup;
  s.other = std::max(0.0, s.solve - s.lcp - s.convolution - s.transform);
  return result;
}

}  // namespace bromwich
