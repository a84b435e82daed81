#include "nonlinear/nonlinear_run.hpp"

#include "core/base/text.hpp"
#include "core/solve/solve.hpp"
#include "nonlinear/frozen_windows.hpp"
#include "nonlinear/pointwise_windows.hpp"
#include "nonlinear/tabulated.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace bromwich {

namespace {

bool is_dense(const NonlinearScene& scene) { return scene.linear.dynamics->small_state() && !scene.of_trace; }

}  // namespace

NonlinearRun::NonlinearRun(const NonlinearScene& scene, const Scene& stated, const std::vector<double>& breaks,
                           Backend& backend, const NonlinearOptions& options)
    : scene_(scene),
      stated_(stated),
      breaks_(breaks),
      backend_(backend),
      options_(options),
      n_(scene.linear.constraints()),
      J_(options.steps > 0 ? options.steps : scene.linear.steps()),
      h_(scene.linear.T / double(J_)) {}

NonlinearResult NonlinearRun::run() {
  const NonlinearMethod by_itself = is_dense(scene_) ? NonlinearMethod::march : NonlinearMethod::iteration;
  result_.method = options_.method == NonlinearMethod::automatic ? by_itself : options_.method;
  result_.t = Vector::LinSpaced(J_ + 1, 0, scene_.linear.T);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  seen() = RowMatrix::Constant(J_ + 1, scene_.seen(), nan);
  result_.y = result_.w = RowMatrix::Constant(J_ + 1, n_, nan);
  seen().row(0) = (scene_.of_trace ? observe(scene_.linear.dynamics, scene_.linear.x0) : scene_.linear.x0).transpose();
  const bool by_linear_scenes = !is_dense(scene_) && result_.method == NonlinearMethod::iteration;
  if (!scene_.phi && !scene_.gamma) {
    solve_linear();
  } else if (!by_linear_scenes && linear_part_solves_it()) {
    return std::move(result_);
  } else if (is_dense(scene_)) {
    solve_dense();
  } else {
    solve_large();
  }
  certify();
  return std::move(result_);
}

// The engine of linear scenes does all of it.
void NonlinearRun::solve_linear() {
  Options options;
  options.method = result_.method == NonlinearMethod::march && is_dense(scene_) ? Method::march : options_.inner;
  options.steps = J_;
  options.states = scene_.of_trace ? StateSelection::none : StateSelection::all;
  options.trace = scene_.of_trace;
  options.interrupted = options_.interrupted;
  Result linear = solve(stated_, backend_, options);
  result_.status = linear.status;
  result_.reason = linear.reason;
  result_.warning = linear.warning;
  result_.continuous = linear.continuous;
  result_.solves = 1;
  if (linear.y.rows() != J_ + 1) return;
  result_.y = std::move(linear.y);
  seen() = std::move(scene_.of_trace ? linear.trace : linear.x);
  for (Index j = 0; j <= J_; ++j) set_slack(j, linear.continuous || j == 0 ? 0 : before_jump(j, breaks_of(j)));
}

// Whether phi and gamma are 0 at the time points of the linear part's solution, which then is that of the discrete
// problem: this sees them there alone where y is linear in between, and at the first stage of the steps where y may
// jump. Tried where they are 0 for x0 and y = 0.
bool NonlinearRun::linear_part_solves_it() {
  const Vector start = seen().row(0), none = Vector::Zero(n_);
  for (const double part : {0.0, 0.37, 1.0})
    if (!vanishes(part * scene_.linear.T, start, none)) return false;
  NonlinearRun linear(*this);
  linear.solve_linear();
  bool same = linear.result_.status == Status::solved;
  for (Index j = 0; same && j <= J_; ++j) {
    const Vector x = linear.seen().row(j).transpose(), y = linear.result_.y.row(j).transpose();
    same = vanishes(result_.t[j], x, y);
    if (linear.result_.continuous || j == 0) continue;
    const Vector before = linear.seen().row(j - 1).transpose();
    same = same && vanishes(result_.t[j] - 2 * h_ / 3, (2 * before + x) / 3, y);
  }
  if (linear.result_.status == Status::interrupted) return result_ = std::move(linear.result_), true;
  if (!same) return false;
  result_ = std::move(linear.result_);
  certify();
  return true;
}

bool NonlinearRun::vanishes(double t, const Vector& x, const Vector& y) const {
  Vector phi = Vector::Zero(scene_.seen()), gamma = Vector::Zero(n_);
  if (scene_.phi) scene_.phi(t, x, y, phi);
  if (scene_.gamma) scene_.gamma(t, x, y, gamma);
  return phi.isZero(0) && gamma.isZero(0);
}

void NonlinearRun::solve_dense() {
  NonlinearSteps steps = make_steps(StepRule::linear);
  Vector y = Vector::Zero(n_);
  if (selects_least(steps.lcp_class(scene_.linear.x0, y))) steps.select_least();
  const NewtonOutcome start = steps.y_at(0, scene_.linear.x0, y);
  if (start.nonfinite) return void(fail(Status::nonfinite, start.why + " at t = 0"));
  const LcpClass of_y = steps.lcp_class(scene_.linear.x0, y);
  result_.continuous = start.solved && is_continuous(of_y);
  if (!result_.continuous) {
    y.setZero();
    if (result_.method != NonlinearMethod::march) {
      result_.reason = "M + dgamma/dy is not of class P or Z, so that y may jump: use method march";
      return;
    }
    steps = make_steps(StepRule::radau);
  }
  steps_ = &steps;
  result_.y.row(0) = y.transpose();
  set_slack(0);
  const bool solved = result_.method == NonlinearMethod::march ? march(0, J_) : by_windows();
  if (solved) result_.status = Status::solved;
  find_defect();
  steps_ = nullptr;
}

// A linear part that is not dense: the linear scenes of the windows solve it, those of single steps for march.
void NonlinearRun::solve_large() {
  if (result_.method == NonlinearMethod::pointwise) {
    result_.reason = "method pointwise takes dense matrices, and phi and gamma of x: use method iteration or newton";
    return;
  }
  result_.y.row(0).setZero();  // a guess
  on_table_ = scene_;
  on_table_.linear.g = tabulated(scene_.linear.g, scene_.linear.T, J_, n_);
  if (scene_.linear.f && scene_.linear.sources() <= n_)
    on_table_.linear.f = tabulated(scene_.linear.f, scene_.linear.T, J_, scene_.linear.sources());
  if (by_windows()) result_.status = Status::solved;
}

NonlinearSteps NonlinearRun::make_steps(StepRule rule) const {
  return NonlinearSteps(scene_, backend_, J_, rule, options_.tolerance, options_.most_newton);
}

bool NonlinearRun::fail(Status status, const std::string& why) {
  result_.status = status;
  result_.reason = why;
  return false;
}

// w at t_j, or on this side of a jump there.
void NonlinearRun::set_slack(Index j, double before) {
  const Vector x = seen().row(j), y = result_.y.row(j);
  const double t = double(j) * h_ - before;
  Vector g = Vector::Zero(n_), gamma = Vector::Zero(n_);
  const TimeFunction& of_time = on_table_.linear.g ? on_table_.linear.g : scene_.linear.g;
  if (of_time) of_time(t, g);
  if (scene_.gamma) scene_.gamma(t, x, y, gamma);
  const Vector v = scene_.of_trace ? x : observe(scene_.linear.dynamics, x);
  result_.w.row(j) = (v + multiply(scene_.linear.M, y) + g + gamma).transpose();
}

// Divisions in (t_{j-1}, t_j].
std::vector<double> NonlinearRun::breaks_of(Index j) const {
  std::vector<double> inside;
  const double near = 4 * side_of_break * scene_.linear.T;
  for (const double b : breaks_)
    if (b > double(j - 1) * h_ + near && b <= double(j) * h_ + near && b < scene_.linear.T - near) inside.push_back(b);
  return inside;
}

// How far before t_j row j stands where f or g jumps there and y may jump; 0 elsewhere.
double NonlinearRun::before_jump(Index j, const std::vector<double>& breaks) const {
  const double side = side_of_break * scene_.linear.T;
  return !breaks.empty() && breaks.back() > double(j) * h_ - 4 * side ? side : 0;
}

NewtonOutcome NonlinearRun::take(Index j, const std::vector<double>& breaks, Vector& x, Vector& y) {
  if (breaks.empty()) return steps_->take(j, x, y);
  const StepOptions options{result_.continuous ? StepRule::linear : StepRule::radau, steps_->selects_least(),
                            options_.tolerance, options_.most_newton, steps_->sizes()};
  return take_divided(scene_, backend_, options, steps_->time(j - 1), h_, breaks, x, y);
}

// Where f or g jumps at t_j, row j has y behind the jump if y is continuous elsewhere, otherwise y before it.
bool NonlinearRun::march(Index from, Index to) {
  Vector x = result_.x.row(from), y = result_.y.row(from);
  for (Index j = from + 1; j <= to; ++j) {
    if (options_.interrupted && options_.interrupted()) return fail(Status::interrupted, "stopped on request");
    const std::vector<double> breaks = breaks_of(j);
    const double before = before_jump(j, breaks);
    NewtonOutcome outcome = take(j, breaks, x, y);
    if (outcome.solved && before > 0 && result_.continuous) outcome = steps_->y_at(j, x, y);
    result_.newton += outcome.iterations;
    if (!outcome.solved) return fail_at(j, outcome);
    ++result_.marched;
    result_.x.row(j) = x.transpose();
    result_.y.row(j) = y.transpose();
    set_slack(j, result_.continuous ? 0 : before);
  }
  return true;
}

bool NonlinearRun::fail_at(Index j, const NewtonOutcome& outcome) {
  const double t = steps_->time(j);
  if (outcome.nonfinite) return fail(Status::nonfinite, text("the step to t = %.6g: %s", t, outcome.why.c_str()));
  if (!outcome.why.empty())
    return fail(Status::tolerance_not_met,
                text("Newton's iteration of the step to t = %.6g ends after %ld iterations: %s; try more steps", t,
                     long(outcome.iterations), outcome.why.c_str()));
  return fail(Status::tolerance_not_met,
              text("Newton's iteration of the step to t = %.6g does not converge (last change %.1e after %ld "
                   "iterations); try more steps",
                   t, outcome.change, long(outcome.iterations)));
}

// The steps from row `from` up to the next one that has to be divided.
Index NonlinearRun::undivided(Index from) const {
  Index to = from;
  while (to < J_ && breaks_of(to + 1).empty()) ++to;
  return to - from;
}

std::unique_ptr<WindowsOfSteps> NonlinearRun::make_windows() const {
  if (result_.method == NonlinearMethod::pointwise)
    return std::make_unique<PointwiseWindows>(scene_, *steps_, backend_, options_);
  const NonlinearMethod method =
      result_.method == NonlinearMethod::iteration ? NonlinearMethod::iteration : NonlinearMethod::newton;
  return std::make_unique<FrozenWindows>(steps_ ? scene_ : on_table_, backend_, options_, method, J_);
}

// Windows of half the length where the iteration does not contract. In dense scenes a step alone, and one with a jump
// of f or g, is marched.
bool NonlinearRun::by_windows() {
  const std::unique_ptr<WindowsOfSteps> made = make_windows();
  WindowsOfSteps& windows = *made;
  Vector state = scene_.linear.x0;
  Index from = 0, length = result_.method == NonlinearMethod::march ? 1 : J_;
  while (from < J_) {
    length = std::min(length, J_ - from);
    const Index free = steps_ ? undivided(from) : length;
    if (steps_ && (length == 1 || free < 2)) {
      if (!march(from, from + 1)) return false;
      ++from;
      state = result_.x.row(from).transpose();
      if (length == 1) length = 2;
      continue;
    }
    const Index count = std::min(length, free);
    WindowsOfSteps::Rows rows{seen().row(from).replicate(count + 1, 1), result_.y.row(from).replicate(count + 1, 1)};
    const auto outcome = windows.solve(from, count, state, rows);
    result_.solves = windows.solves();
    result_.newton += windows.newton() - counted_newton_;
    counted_newton_ = windows.newton();
    if (windows.interrupted()) return fail(Status::interrupted, "stopped on request");
    if (!outcome && count > 1) {
      length = (count + 1) / 2;
      continue;
    }
    if (!outcome)
      return fail(Status::tolerance_not_met,
                  text("step to t = %.6g: %s; take more steps, or more of phi and gamma into the linear part",
                       double(from + 1) * h_, windows.reason().c_str()));
    if (!windows.continuous()) {
      result_.continuous = false;
      return fail(Status::unsupported,
                  "y may jump from step to step, and phi and gamma between the time points are not known");
    }
    keep(from, rows);
    result_.method == NonlinearMethod::march ? ++result_.marched : ++result_.windows;
    result_.contraction = std::max(result_.contraction, outcome->contraction);
    result_.defect = std::max(result_.defect, outcome->change);
    from += count;
    if (from < J_) state = windows.end_state(rows);
  }
  return true;
}

void NonlinearRun::keep(Index from, const WindowsOfSteps::Rows& rows) {
  const Index first = from == 0 ? 0 : 1;
  const HostThreads one;
  const bool at_once = options_.concurrent && (!scene_.linear.g || on_table_.linear.g);  // several threads may call g
  share(at_once ? static_cast<const HostThreads&>(backend_) : one, rows.y.rows() - first, 16,
        [&](Index begin, Index end) {
          for (Index j = first + begin; j < first + end; ++j) {
            seen().row(from + j) = rows.seen.row(j);
            result_.y.row(from + j) = rows.y.row(j);
            set_slack(from + j);
          }
        });
}

// Of steps that were not divided.
void NonlinearRun::find_defect() {
  if (!result_.continuous) return;
  result_.defect = 0;
  for (Index j = 1; j <= J_ && result_.x.row(j).allFinite(); ++j) {
    if (!breaks_of(j).empty()) continue;
    const Vector x0 = result_.x.row(j - 1), y0 = result_.y.row(j - 1), x1 = result_.x.row(j), y1 = result_.y.row(j);
    result_.defect = std::max(result_.defect, steps_->defect(j, x0, y0, x1, y1).cwiseAbs().maxCoeff() /
                                                  std::max(1.0, x1.cwiseAbs().maxCoeff()));
  }
}

void NonlinearRun::certify() {
  for (Index j = result_.continuous ? 0 : 1; j <= J_ && seen().row(j).allFinite(); ++j) {
    const Vector y = result_.y.row(j), w = result_.w.row(j);
    const Vector fixed = w - multiply(scene_.linear.M, y);
    result_.residual =
        std::max(result_.residual, w.cwiseMin(y).cwiseAbs().maxCoeff() / std::max(1.0, fixed.cwiseAbs().maxCoeff()));
  }
}

}  // namespace bromwich
