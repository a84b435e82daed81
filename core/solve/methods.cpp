#include "core/solve/methods.hpp"

#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/iteration/functional_iteration.hpp"
#include "core/iteration/literal.hpp"
#include "core/iteration/windows.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "core/kernel/pole_plans.hpp"
#include "core/march/impacts.hpp"
#include "core/march/marching.hpp"
#include "core/march/split.hpp"
#include "core/march/stages.hpp"
#include "core/multigrid/dual.hpp"
#include "core/multigrid/multigrid.hpp"
#include "core/result/notice.hpp"
#include "core/seam/chunk_march.hpp"

#include <algorithm>
#include <iterator>
#include <numeric>

namespace bromwich {

namespace {

void refuse(const std::string& why, Result& result) {
  result.status = Status::unsupported;
  result.reason = why + "; use method march or euler";
}

constexpr double most_surplus = 0.25, told_surplus = 0.04;  ///< of the integral of y, from the start (surplus_of_start)
constexpr Index largest_divided = 512;  ///< constraints, of steps in stages that are divided at jumps of g

// Why no contact settles in sweeps of the iteration: y_i of one time point acts on w_i of the same more than M_ii, for
// every i. A set S of contacts is multiplied by M_SS^{-1} (W_0)_SS then, whose largest eigenvalue is at least the
// largest ratio of the diagonals where both are symmetric. Empty: not known.
// For dynamics known by shifted solves alone; dense ones and Kronecker sums have forecasts of their own.
std::string never_contracts(const DiscreteProblem& p, TimeOperator& op) {
  if (p.small_state() || p.modes() || selects_least(p.lcp_class)) return "";
  const SharedWeights weights = op.kernel_weights(ConvolutionChoice::automatic).weights;
  const Index n = p.scene.constraints();
  Vector first;
  if (const auto* poles = std::get_if<PoleRecurrence>(weights.get()))
    first = implicit_part(*poles).diagonal();
  else if (const auto* table = std::get_if<LagTable>(weights.get()); table && !table->modal)
    first = Eigen::Map<const RowMatrix>(table->W.row(0).data(), n, n).diagonal();
  const Vector own = diagonal(p.scene.M);
  if (first.size() != n || !(first.array() >= own.array()).all()) return "";
  const std::string why = "no contact settles in sweeps: the first lag W_0 of the kernel outweighs M in every row";
  return own.minCoeff() > 0 ? why + text(", by %.2g and more", (first.array() / own.array()).minCoeff()) : why;
}

DiscreteProblem with_all_components(const DiscreteProblem& given) {
  DiscreteProblem p = given;
  p.components.resize(std::size_t(p.scene.states()));
  std::iota(p.components.begin(), p.components.end(), Index(0));
  return p;
}

}  // namespace

Methods::Methods(const Scene& scene, Backend& backend, Index J, const std::vector<Index>& components,
                 bool look_inside_every_step, std::shared_ptr<GridFamily> family)
    : family_(family ? std::move(family) : std::make_shared<GridFamily>()),
      problem_(discretise(scene, backend, J, look_inside_every_step, family_.get())),
      look_inside_every_step_(look_inside_every_step) {
  problem_.components = components;
  operator_ = make_time_operator(problem_);
  average_sources();
}

void Methods::average_sources() {
  kept_.erase(Method::euler);
  kept_.erase(Method::dual);
  euler_operator_.reset();
  averaged_.reset();
  if (!problem_.sources) return;
  averaged_.emplace(with_mean_sources(problem_));
  euler_operator_ = make_time_operator(*averaged_);
}

void Methods::keep_prepared() {
  keeps_ = true;
  operator_->keep_prepared();
}

void Methods::renew(const Changes& changes) {
  if (!changes.any()) return;
  const bool had_sources = problem_.f.size() > 0;
  changes.sources ? sample_sources(problem_, look_inside_every_step_) : set_start(problem_);
  operator_->renew(changes);
  const bool averages = averaged_.has_value() || problem_.sources;
  if (averages) average_sources();
  if (had_sources != (problem_.f.size() > 0)) kept_.clear();  // plans have arrays for f, or have none
  for (auto& [method, kept] : kept_) kept.due.add(changes);
}

bool Methods::run_prepared(Method method, const Options& options, Result& result,
                           const std::function<std::unique_ptr<PreparedMethod>()>& prepare) {
  Timer timer;
  Kept& kept = kept_[method];
  if (!kept.method)
    kept.method = prepare();
  else
    kept.method->renew(kept.due);
  kept.due = no_changes;
  result.seconds.setup += timer.lap();
  if (!kept.method) return false;
  kept.method->run(options, result);
  if (!keeps_) kept_.erase(method);
  return true;
}

const Methods::MethodOfSteps& Methods::row_of(Method method) {
  static constexpr MethodOfSteps rows[] = {
      {Method::march, false, &Methods::march},     {Method::euler, false, &Methods::step_by_euler},
      {Method::multigrid, false, &Methods::cycle}, {Method::dual, false, &Methods::cycle_in_w_alone},
      {Method::contour, true, &Methods::iterate},  {Method::contour_literal, true, &Methods::iterate_literally},
      {Method::shooting, false, &Methods::shoot},
  };
  const auto found = std::find_if(std::begin(rows), std::end(rows), [&](const auto& r) { return r.method == method; });
  return found == std::end(rows) ? rows[0] : *found;
}

void Methods::run(Method method, const InnerOptions& options, Result& result) {
  result.method = method;
  result.t = problem_.t;
  result.steps = problem_.J;
  Timer timer;
  if (method != Method::euler && method != Method::dual && !basis().rings) operator_->missing_weights();
  result.seconds.setup += timer.lap();
  const MethodOfSteps& row = row_of(method);
  if (row.y_is_line && basis().rings)
    refuse(basis().reason + ": " + basis().refusal, result);
  else
    (this->*row.run)(options, result);
  judge_start(method, result);
  record_states(method, result);
  report_sources(result);
}

void Methods::step_by_euler(const InnerOptions& options, Result& result) {
  if (!operator_->marches_by_euler()) return step_in_stages(1, options, result);
  run_prepared(Method::euler, options, result,
               [&] { return prepare_march(operator_of(Method::euler), Rule::implicit_euler, options); });
}

void Methods::cycle_in_w_alone(const InnerOptions& options, Result& result) {
  cycle_in_w(Method::dual, options, result);
}

void Methods::iterate_literally(const InnerOptions& options, Result& result) {
  if (!problem_.small_state() && !problem_.modes())
    return refuse("contour-literal works with dense dynamics and Kronecker sums", result);
  solve_literally(problem_, options, result);
}

// Long marches of small scenes with given steps: one chunk of time, by the affine pieces of its steps.
std::optional<ScanPlan> Methods::plan_of_march(const InnerOptions& options) const {
  constexpr Index fewest_steps = 16384;  // below, pieces are found for too few
  if (!problem_.small_state() || !options.by_pieces || options.compares_grids || problem_.J < fewest_steps)
    return std::nullopt;
  ScanPlan plan;
  plan.threads = &problem_.backend;
  plan.chunks = 1;
  plan.interrupted = options.interrupted;
  return plan;
}

void Methods::march(const InnerOptions& options, Result& result) {
  if (const auto rows = rows_of_impacts(problem_)) return step_over_impacts(*rows, options, result);
  if (needs_location(problem_)) return refuse_impacts(result);
  const std::optional<ScanPlan> plan = plan_of_march(options);
  const ScanPlan* const by_pieces = plan ? &*plan : nullptr;
  // Where stepping the state costs a solve a step, only what would ring keeps it from the weights.
  if (basis().rings || basis().only_in_sweeps || (!basis().continuous && !operator_->prefers_weights())) {
    step_in_stages(2, options, result, by_pieces);
    result.kernel += "; " + basis().reason;
  } else if (operator_->takes_parts()) {
    solve_by_split_marching(problem_, options, result, by_pieces);
  } else if (divides_in_stages()) {
    step_in_stages(2, options, result, by_pieces);
  } else if (const std::string why = operator_->missing_weights(); why.empty()) {
    march_by_weights(options, result);
  } else {
    step_in_stages(2, options, result, by_pieces);
    result.kernel += "; " + why;
  }
}

// The steps of march by chunks of time.
void Methods::shoot(const InnerOptions& options, Result& result) {
  if (!problem_.small_state()) return refuse("method shooting: the dynamics are not dense", result);
  ScanPlan plan;
  plan.threads = &problem_.backend;
  plan.device = dynamic_cast<ChunkMarcher*>(&problem_.backend);
  plan.by_pieces = options.by_pieces && !options.compares_grids;
  plan.chunks = options.chunks;
  plan.coarse_start = options.coarse_start;
  plan.interrupted = options.interrupted;
  if (basis().rings || basis().only_in_sweeps || !basis().continuous) {
    step_in_stages(2, options, result, &plan);
    result.kernel += "; " + basis().reason;
  } else {
    solve_by_split_marching(problem_, options, result, &plan);
  }
}

void Methods::march_by_weights(const InnerOptions& options, Result& result) {
  const Result unsolved = result;
  run_prepared(Method::march, options, result, [&] { return prepare_march(*operator_, Rule::exponential, options); });
  if (surplus_of_start(Method::march, result) <= most_surplus) return;
  Result in_stages = unsolved;
  in_stages.seconds = result.seconds;
  step_in_stages(2, options, in_stages);
  if (in_stages.status != Status::solved) return;
  result = std::move(in_stages);
  result.kernel += "; y falls from its first value within a step";
}

// Where x0 violates the constraints y_0 answers it, and dynamics that decide y let it vanish within a step. As a line
// over the first step it then moves the state by a multiple of what y does. This is the part of the integral of y that
// such a line may add, or a bound below told_surplus; of few steps the first is no small part in any case. Small states
// have rules that see it in their matrices.
double Methods::surplus_of_start(Method method, const Result& result) const {
  constexpr Index fewest_steps = 16;
  if (problem_.J < fewest_steps) return 0;
  if (problem_.small_state() || by_euler(method, result) || !result.continuous || result.y.rows() < 2) return 0;
  if (result.status != Status::solved || !(problem_.start.array() < 0).any()) return 0;
  const double fall = (result.y.row(0) - result.y.row(1)).maxCoeff(), added = 0.5 * problem_.h * fall;
  Vector integral = Vector::Zero(result.y.cols());
  double largest = 0;
  for (Index j = 1; j < result.y.rows() && added > told_surplus * largest; ++j) {
    integral += problem_.h / 2 * (result.y.row(j - 1) + result.y.row(j)).transpose();
    largest = std::max(largest, integral.cwiseAbs().maxCoeff());
  }
  return largest > 0 ? std::max(0.0, added / largest) : 0;
}

// Other methods than march are not replaced by another one.
void Methods::judge_start(Method method, Result& result) const {
  const double surplus = surplus_of_start(method, result);
  if (surplus <= told_surplus) return;
  if (surplus <= most_surplus)
    return tell(result, {.code = NoticeCode::error_of_steps, .other = surplus, .of_mean = true});
  result.status = Status::tolerance_not_met;
  result.reason = text(
      "x0 violates the constraints, and y falls from its first value within a step, whose line adds up to %.0f %% of "
      "the integral of y: use more steps or method march",
      100 * surplus);
}

// Without a small state, weights of steps hold no parts of steps. The stages of parts do, where n x n matrices are
// small enough for one of each length. y needs them where g jumps, and recorded states, which take a solve a step
// anyway, where f does.
bool Methods::divides_in_stages() const {
  if (!problem_.sources || problem_.scene.constraints() > largest_divided) return false;
  const bool records = !problem_.components.empty() && problem_.scene.dynamics->matrices();
  return problem_.sources->jumps_of_g || records;
}

// Small states are recorded whole, and the requested components are taken from them.
void Methods::step_in_stages(Index stages, const InnerOptions& options, Result& result, const ScanPlan* plan) {
  if (problem_.scene.states() > most_recorded_states)
    return solve_by_stages(problem_, stages, options, result, stages == 2 ? operator_->poles() : nullptr, plan);
  solve_by_stages(with_all_components(problem_), stages, options, result, nullptr, plan);
  keep_recorded(result);
}

void Methods::step_over_impacts(const ImpactRows& rows, const InnerOptions& options, Result& result) {
  if (problem_.scene.states() > most_recorded_states) return solve_over_impacts(problem_, rows, options, result);
  solve_over_impacts(with_all_components(problem_), rows, options, result);
  keep_recorded(result);
}

// All of a small state are recorded: the requested components of them.
void Methods::keep_recorded(Result& result) {
  if (result.x.cols() != problem_.scene.states()) return;
  stage_states_ = std::move(result.x);
  result.x = stage_states_(Eigen::all, problem_.components);
}

// Cycles in w at the stages record all of a small state.
void Methods::keep_all_states(Result& result) {
  if (!result.continuous && problem_.scene.states() <= most_recorded_states) keep_recorded(result);
}

bool Methods::has_small_dense_state(const Scene& scene) {
  return scene.dynamics->small_state() && scene.states() <= most_recorded_states;
}

RowMatrix Methods::all_states(Method method, const Result& result) const {
  if (!result.continuous) return stage_states_;
  std::vector<Index> all(std::size_t(problem_.scene.states()));
  std::iota(all.begin(), all.end(), Index(0));
  const bool euler = by_euler(method, result);
  const Rule rule = euler ? Rule::implicit_euler : Rule::exponential;
  return operator_of(euler ? Method::euler : method).states(rule, result.y, all, result.defects.get());
}

void Methods::iterate(const InnerOptions& options, Result& result) {
  if (const std::string why = operator_->missing_weights(); !why.empty()) return refuse(why, result);
  if (const std::string why = never_contracts(problem_, *operator_); !why.empty()) return refuse(why, result);
  const Index window = iteration_window(problem_, options.iteration_tolerance);
  if (window < problem_.J)
    note(options.log, LogLevel::info, "sweeps contract on windows of at most %ld of %ld steps", long(window),
         long(problem_.J));
  if (window < problem_.J) return solve_in_windows(problem_, window, options, result);
  run_prepared(Method::contour, options, result, [&] { return prepare_iteration(*operator_, options); });
}

void Methods::cycle(const InnerOptions& options, Result& result) {
  if (basis().rings) return void(cycle_in_w(Method::multigrid, options, result));
  if (const std::string why = operator_->missing_weights(); !why.empty()) return refuse(why, result);
  if (run_prepared(Method::multigrid, options, result, [&] { return prepare_multigrid(*operator_, options); })) {
    result.form = "primal";
    return;
  }
  // Without coarse grids that contract, cycles in w may. True if they stand in the result.
  const auto try_in_w = [&](bool only_solved) {
    Result dual;
    dual.seconds = result.seconds;
    dual.method = result.method;
    dual.t = result.t;
    dual.steps = result.steps;
    if (!cycle_in_w(Method::multigrid, options, dual)) return false;
    if (only_solved && dual.status != Status::solved && dual.status != Status::interrupted) return false;
    result = std::move(dual);
    return true;
  };
  const auto f = iteration_forecast(problem_, options.iteration_tolerance);
  const bool hopeless =
      (f && f->longest_window(options.iteration_tolerance) == 0) || !never_contracts(problem_, *operator_).empty();
  if (hopeless && try_in_w(false)) return;
  note(options.log, LogLevel::info, "multigrid has no coarser grid here: the functional iteration");
  iterate(options, result);
  result.kernel += "; no coarser grid: the functional iteration";
  if (!hopeless && result.status == Status::tolerance_not_met) try_in_w(true);
}

// False, with the reason in the result, if the problem has no dual form.
bool Methods::cycle_in_w(Method method, const Options& options, Result& result) {
  std::string why;
  if (run_prepared(Method::dual, options, result,
                   [&] { return prepare_dual(operator_of(Method::euler), options, why); })) {
    keep_all_states(result);
    return true;
  }
  result.status = Status::unsupported;
  result.reason = (method == Method::dual ? "no cycles in w: " : basis().reason + ", and no cycles in w: ") + why +
                  "; use method march or euler";
  return false;
}

// States recorded by the method are kept; otherwise they are computed from y.
void Methods::record_states(Method method, Result& result) {
  const Index rows = problem_.J + 1, c = Index(problem_.components.size());
  if (result.y.size() == 0) result.y = RowMatrix::Constant(rows, problem_.scene.constraints(), NAN);
  if (result.x.rows() == rows && result.x.cols() == c) return;
  const bool euler = by_euler(method, result);
  const Rule rule = euler ? Rule::implicit_euler : Rule::exponential;
  result.x =
      operator_of(euler ? Method::euler : method).states(rule, result.y, problem_.components, result.defects.get());
}

TimeOperator& Methods::operator_of(Method method) const {
  return method == Method::euler && euler_operator_ ? *euler_operator_ : *operator_;
}

constexpr double seen_in_parts = 0.01;  ///< of a source: error in parts of steps above which a warning is given

// Reports sources that the grid does not resolve.
void Methods::report_sources(Result& result) const {
  if (!problem_.sources) return;
  const SourceSteps& s = *problem_.sources;
  const bool parts = result.defects != nullptr;
  result.rough_steps = Index(s.rough.size());
  result.jumps_inside = s.jumps_of_g && !parts;
  result.unresolved_sources = std::max(s.disagreement, parts ? 0 : s.disagreement_of_g);
}

// Where no certificate says what they cost.
void Methods::tell_sources(Result& result) const {
  if (!problem_.sources) return;
  const SourceSteps& s = *problem_.sources;
  const bool parts = result.defects != nullptr;
  if (s.unresolved > 0 || s.disagreement > seen_in_parts || (!parts && s.disagreement_of_g > 0))
    bromwich::tell_sources(s.unresolved > 0 ? NAN : result.unresolved_sources, s.time, result);
  else if (result.jumps_inside)
    tell(result, {NoticeCode::undivided_jumps});
}

void tell_sources(double missed, double t, Result& result) {
  tell(result, {.code = NoticeCode::unresolved_sources, .size = missed, .t = t});
}

}  // namespace bromwich
