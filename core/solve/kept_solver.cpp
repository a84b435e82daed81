#include "core/solve/kept_solver.hpp"

#include "core/base/timer.hpp"
#include "core/kernel/shared_dynamics.hpp"
#include "core/lcp/same_matrix.hpp"
#include "core/result/inner_options.hpp"
#include "core/scene/scene.hpp"
#include "core/solve/engines.hpp"
#include "core/solve/prepared.hpp"
#include "core/solve/solver.hpp"

#include <functional>
#include <tuple>
#include <utility>

namespace bromwich {

namespace {

// Others have data that change behind their handle, or prepare nothing that takes time.
bool is_worth_keeping(const Scene& scene, const Options& options) {
  const bool large = scene.dynamics->modes() || scene.dynamics->matrices();
  return large && !scene.dynamics->small_state() && !scene.boundary && !scene.port && !options.tuning.first_iterate;
}

auto numbers_of(const Tuning& t) {
  return std::tuple(t.convolution, t.recurrence, t.substitutes_euler, t.dual_by_euler, t.literal_nodes,
                    t.algebraic_share);
}

// All but functions, of which it matters whether there are any.
auto numbers_of(const Options& o) {
  return std::tuple(o.method, o.steps, o.tolerance, o.tolerance_x, o.tolerance_y, o.absolute_tolerance,
                    o.control_states, o.max_steps, o.max_seconds, o.iteration_tolerance, o.max_iterations, o.states,
                    o.components, o.trace, o.event_location, o.confirm, o.goal, o.memory_limit, bool(o.progress),
                    bool(o.interrupted), bool(o.log), numbers_of(o.tuning));
}

bool same_values(const Matrix& a, const Matrix& b) { return a.rows() == b.rows() && a.cols() == b.cols() && a == b; }

bool same_dynamics(const Dynamics& a, const Dynamics& b) {
  if (&*a == &*b) return true;
  const auto *p = a->small_state(), *q = b->small_state();
  return p && q && same_values(p->A, q->A) && same_values(p->B, q->B) && same_values(p->N, q->N) &&
         same_values(p->E, q->E);
}

}  // namespace

bool share_preparation(const Scene& a, const Scene& b) {
  return same_dynamics(a.dynamics, b.dynamics) && a.lcp_class == b.lcp_class && a.T == b.T &&
         a.default_steps == b.default_steps && a.f_entry == b.f_entry && bool(a.f) == bool(b.f) &&
         a.free_rows == b.free_rows && !a.boundary && !b.boundary && !a.port && !b.port && same(a.F, b.F) &&
         same(a.M, b.M) && same_values(a.restitution, b.restitution) && a.cones.empty() && b.cones.empty() &&
         a.memories.empty() && b.memories.empty();
}

// As a Solver, with the dynamics of the caller: a copy could not be compared with them next time.
struct KeptSolver::Kept {
  Kept(const Scene& given, const Options& given_options) : scene(given), options(InnerOptions{given_options}) {
    options.prepared = std::make_shared<Prepared>();
    options.prepared->stated = &scene;
    options.prepared->units_may_change = true;
    options.family = std::make_shared<GridFamily>(controls_error(options));
    // Plans keep the functions that they were made with.
    if (options.progress) options.progress = [this](const Progress& p) { now.progress(p); };
    if (options.interrupted) options.interrupted = [this] { return now.interrupted(); };
    if (options.log) options.log = [this](const LogEntry& entry) { now.log(entry); };
  }

  bool serves(const Scene& given, const Options& given_options) const {
    return numbers_of(options) == numbers_of(given_options) && share_preparation(scene, given);
  }

  void take(const Scene& given) {
    options.prepared->add({scene.x0 != given.x0, true});
    scene.x0 = given.x0;
    scene.f = given.f;
    scene.g = given.g;
    scene.breakpoints = given.breakpoints;
    scene.breakpoints_are_all = given.breakpoints_are_all;
    scene.no_pulses = given.no_pulses;
    scene.exact = given.exact;
  }

  Result solve(Backend& backend, const Options& given_options) {
    now = {given_options.progress, given_options.interrupted, given_options.log};
    options.prepared->end_of_solve();
    Result result = solve_valid(scene, backend, options);
    now = {};
    return result;
  }

 private:
  Scene scene;
  InnerOptions options;
  struct {
    std::function<void(const Progress&)> progress;
    std::function<bool()> interrupted;
    Log log;
  } now;  ///< of the solve that runs
};

KeptSolver::KeptSolver(Backend& backend) : backend_(backend) {}
KeptSolver::~KeptSolver() = default;

void KeptSolver::forget() { kept_ = nullptr; }

Result KeptSolver::solve(const Scene& scene, const Options& given) {
  if (!is_worth_keeping(scene, given)) {
    forget();
    return bromwich::solve(scene, backend_, given);
  }
  Timer timer;
  scene.validate();
  const double looked = timer.lap();
  const Options options = with_defaults(given, scene);
  if (kept_ && kept_->serves(scene, options)) {
    kept_->take(scene);
  } else {
    forget();  // the old plans free their memory before new ones take theirs
    kept_ = std::make_unique<Kept>(scene, options);
  }
  std::unique_ptr<Kept> used = std::move(kept_);  // what an exception leaves is half of this solve and half of the last
  Result result = used->solve(backend_, options);
  kept_ = std::move(used);
  result.seconds.setup += looked;
  result.seconds.total += looked;
  return result;
}

}  // namespace bromwich
