#include "core/events/event_step.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index degree = Collocation::degree;
constexpr double rounding_tail = 1e-10;   ///< of last coefficients: below, rounding is the cause where it stays
constexpr double noise_share = 10;        ///< of the tolerance: negative values below count as zero
constexpr double shortest_share = 1e-14;  ///< of T
constexpr double of_source = 100;         ///< one value of one component of a source, in floating-point operations
constexpr double overhead = 4000;         ///< of a step, likewise
constexpr double rounding_defect = 3e-13;

// The last two coefficients, or a difference that was seen, relative to the sizes. Coefficients up to `rounding` count
// as zero.
double tail(const LegendreCoefficients& c, const Vector& size, const Vector& off, const Vector& rounding) {
  if (size.size() == 0) return 0;
  const double floor = 1e-4 * size.maxCoeff() + 1e-280;
  double largest = 0;
  for (Index i = 0; i < c.cols(); ++i) {
    double last = std::abs(c(degree, i)) + std::abs(c(degree - 1, i));
    if (rounding.size() > 0) last = std::max(0.0, last - rounding[i]);
    const double seen = off.size() > 0 ? off[i] : 0;
    const double share = std::max(last, seen) / std::max(size[i], floor);
    if (!std::isfinite(share)) return INFINITY;
    largest = std::max(largest, share);
  }
  return largest;
}

void set_larger(const Vector& before, const LegendreCoefficients& c, Vector& size) {
  size = before;
  if (c.size() > 0) size = size.cwiseMax(bounds(c));
}

// d^k/dt^k of polynomials on a step of length h. Within a short step it may be rounding of the values, and is zero
// then.
LegendreCoefficients derivative(const LegendreCoefficients& values, int k, double h) {
  static const Collocation::Square& D = Collocation::get().derivative;
  static const double steepest = D.cwiseAbs().colwise().sum().maxCoeff();
  LegendreCoefficients c = values;
  double grown = 64 * epsilon;
  for (int i = 0; i < k; ++i) {
    c = (D * c / h).eval();
    grown *= steepest / h;
  }
  for (Index i = 0; i < c.cols(); ++i)
    if (c.col(i).cwiseAbs().sum() <= grown * values.col(i).cwiseAbs().sum()) c.col(i).setZero();
  return c;
}

// h (I - hA)^{-1}: how constant inputs move the state in a step of implicit Euler. Fast modes that decay count with the
// states to which they tend, and not with h times their rates. Where a mode grows much, this is singular or too small:
// h I.
Matrix moved_within(double h, const Matrix& A) {
  constexpr double much = 0.5;
  const Matrix I = Matrix::Identity(A.rows(), A.rows());
  if (A.rows() > 0 && h * Eigen::EigenSolver<Matrix>(A, false).eigenvalues().real().maxCoeff() > much) return h * I;
  return h * (I - h * A).partialPivLu().inverse();
}

}  // namespace

void EventStep::set_without_x(const JetCombination& rows, Index count, LegendreCoefficients& sum) const {
  sum.setZero(Eigen::NoChange, count);
  rows.f.add(sources.f, sum);
  rows.g.add(sources.g, sum);
  if (df.size() > 0) rows.df.add(df, sum);
  if (dg.size() > 0) rows.dg.add(dg, sum);
  if (ddg.size() > 0) rows.ddg.add(ddg, sum);
}

void EventSizes::set_with(const EventSizes& before, const EventStep& step) {
  set_sources_with(before, step);
  set_values_with(before, step);
}

void EventSizes::set_values_with(const EventSizes& before, const EventStep& step) {
  set_larger(before.u.x, step.x, u.x);
  set_larger(before.y, step.y, y);
}

void EventSizes::set_sources_with(const EventSizes& before, const EventStep& step) {
  set_larger(before.u.f, step.sources.f, u.f);
  set_larger(before.u.df, step.df, u.df);
  set_larger(before.u.g, step.sources.g, u.g);
  set_larger(before.u.dg, step.dg, u.dg);
  set_larger(before.u.ddg, step.ddg, u.ddg);
}

EventSizes EventSizes::with(const EventStep& step) const {
  EventSizes all;
  all.set_with(*this, step);
  return all;
}

EventSteps::EventSteps(const SystemMatrices& system, const EventSources& sources, double T, const StepLimits& limits)
    : system_(system),
      sources_(sources),
      T_(T),
      propagators_(limits.longest),
      B_(system.B),
      N_(system.N),
      M_(system.M),
      rigid_((openings(system).array() > 0).any()) {
  begin(limits);
}

void EventSteps::begin(const StepLimits& limits) {
  sign_is_lost_ = false;
  first_lengths_.clear();
  if (limits == limits_) return;
  if (limits_.longest > 0 && limits.longest != limits_.longest) propagators_ = Propagators(limits.longest);
  limits_ = limits;
  by_f_within_span_ = moved_within(limits.span, system_.A);
  by_y_within_span_ = (by_f_within_span_ * system_.B).cwiseAbs();
  by_f_within_step_ = moved_within(usual_length(), system_.A);
  by_y_within_step_ = (by_f_within_step_ * system_.B).cwiseAbs();
  by_f_within_span_ = by_f_within_span_.cwiseAbs();
  by_f_within_step_ = by_f_within_step_.cwiseAbs();
}

// Up to the next breakpoint, by a time that recurs with it: times are known to rounding.
double EventSteps::longest_from(const EventPoint& p) const {
  constexpr double no_step = 0.01;  // of a step: less is not left for another one, in which y has no sign
  const double h = std::min(p.h, limits_.longest), rest = p.end - p.t, known = 4 * epsilon * T_;
  if (const double step = propagators_.grid_length(h); h < rest && (1 + no_step) * step < rest) return step;
  return std::max(1.0, std::round(rest / known)) * known;
}

double EventSteps::noise() const { return noise_share * limits_.tolerance; }

void EventSteps::sample(const SwitchedMode& mode, double t, double h, EventStep& step) const {
  sources_.sample(t, h, step.sources);
  const LegendreCoefficients none;
  step.df = mode.uses_df ? derivative(step.sources.f, 1, h) : none;
  step.dg = mode.uses_dg ? derivative(step.sources.g, 1, h) : none;
  step.ddg = mode.uses_ddg ? derivative(step.sources.g, 2, h) : none;
}

double EventSteps::sample_resolved(const SwitchedMode& mode, const EventPoint& p, EventStep& step) const {
  constexpr int most_shortened = 12;
  double h = longest_from(p) / 16;
  for (int k = 0;; ++k, h /= 4) {
    sample(mode, p.t, h, step);
    if (k == most_shortened || source_defect(p.sizes.with(step).u, step.sources) <= 0.1 * limits_.tolerance) return h;
  }
}

double EventSteps::source_defect(const JetValues& size, const EventSources::Polynomials& p) const {
  return std::max(tail(p.f, size.f, p.off_f, {}), tail(p.g, size.g, p.off_g, {}));
}

// Collocation keeps the constraints of the mode but for rounding, that of terms of y which cancel. It is taken out: it
// would add up from step to step. Not where g' enters, whose rounding is larger.
void EventSteps::hold_constraints(const SwitchedMode& mode, EventStep& step) {
  step.set_without_x(mode.sum_constraints, mode.constraints.x.rows(), off_);
  mode.sum_constraints.x.add(step.x, off_);
  off_.row(0) -= legendre(0).transpose() * off_;
  step.x.noalias() -= off_ * mode.onto.transpose();
}

// It ends early where the defect is known to be too large.
void EventSteps::attempt(const SwitchedMode& mode, EventPoint& p, double h, EventStep& step) {
  const Collocation& c = Collocation::get();
  const Index m = system_.states(), n = system_.constraints();
  const double too_large = std::max(limits_.tolerance, rounding_tail);
  step.length = h;
  sample(mode, p.t, h, step);
  p.work += double(c.samples.size() + c.checks.size()) * work_of_sources() + overhead;
  const JetValues& size = step.sizes.u;
  step.sizes.set_sources_with(p.sizes, step);
  step.defect = source_defect(size, step.sources);
  if (!(step.defect <= too_large)) return;
  step.set_without_x(mode.sum_y, n, y_of_sources_);
  input_ = step.sources.f;
  B_.add(y_of_sources_, input_);
  input_.row(0).noalias() += p.x.transpose() * mode.A.transpose();
  const LegendreCoefficients& whole = propagators_.move(mode, h, input_, step.x, p.work);
  step.x.row(0) += p.x.transpose();
  if (!rigid_ && mode.constraints.x.rows() > 0) hold_constraints(mode, step);
  step.y = y_of_sources_;
  mode.sum_y.x.add(step.x, step.y);
  step.sizes.set_values_with(p.sizes, step);
  p.work += double((degree + 1) * (degree + 1) * (6 * m + 3 * n) + 80 * m * m + (degree + 1) * (4 * m * n + 2 * n * n));
  set_rounding_of_x(size.f, step.sizes.y, h, rounding_x_);
  step.defect = std::max(step.defect, tail(whole, size.x, {}, rounding_x_));
  if (!(step.defect <= too_large)) return;
  step.w = step.sources.g;
  N_.add(step.x, step.w);
  M_.add(step.y, step.w);
  set_zeros(mode, p, step);
  step.defect = std::max(step.defect, defect_of_signs(mode, step));
}

Vector EventSteps::rounding_of_x(const EventSizes& sizes) const {
  Vector rounding;
  set_rounding_of_x(sizes.u.f, sizes.y, 0, rounding);
  return rounding;
}

// By values of f and y of these sizes.
void EventSteps::set_rounding_of_x(const Vector& f, const Vector& y, double length, Vector& rounding) const {
  rounding.noalias() = by_f_within_step_ * f;
  rounding.noalias() += by_y_within_step_ * y;
  rounding *= 64 * epsilon * longer_than_usual(length);
}

// Of one value of f and of g.
double EventSteps::work_of_sources() const {
  return sources_.may_bend() ? of_source * double(system_.states() + system_.constraints()) : 0;
}

// Looks at the sources at more times: both ends, and times between the samples of a long step.
void EventSteps::look_closer(EventPoint& p, EventStep& step) const {
  if (!sources_.may_bend()) return;
  sources_.look_at_ends(p.t, step.length, step.sources);
  p.work += double(2 + sources_.look_between(p.t, step.length, step.sources)) * work_of_sources();
  step.defect = std::max(step.defect, source_defect(step.sizes.u, step.sources));
}

double EventSteps::room(const EventStep& step) const {
  constexpr double most = 3;
  if (!(step.defect > rounding_defect)) return most;  // rounding makes defects that say nothing of the step
  return std::min(most, 0.9 * std::pow(limits_.tolerance / step.defect, 1.0 / double(degree)));
}

bool EventSteps::resolve_first(const SwitchedMode& mode, EventPoint& p, EventStep& step) {
  double& known = first_lengths_[&mode];
  const double proposed = p.h;
  bool limits = known > 0 && known < longest_from(p);
  if (limits) {
    const bool lost = sign_is_lost_;
    p.h = known;
    limits = resolve(mode, p, step);
    p.h = proposed;
    if (!limits) known = 0, sign_is_lost_ = lost;  // the sign of y may be known on a longer step
  }
  if (!limits && !resolve(mode, p, step)) return false;
  const double longest = step.length * std::max(1.0, room(step));
  known = step.shortened ? longest : std::max(known, longest);
  step.shortened = step.shortened || limits;
  return true;
}

bool EventSteps::resolve(const SwitchedMode& mode, EventPoint& p, EventStep& step, const std::vector<char>* free) {
  double h = longest_from(p);
  double before = INFINITY;
  bool shortened = false;
  for (int k = 0; k < 80; ++k) {
    attempt(mode, p, h, step);
    step.shortened = shortened;
    // Where a shorter step does not help, rounding is left: t is known to 1e-16, and sin(1e5 t) to 1e-11. (A transient
    // far shorter than the step stays too, but is larger.)
    const bool rounding = step.defect <= rounding_tail && step.defect > 0.5 * before;
    if (step.defect <= limits_.tolerance) look_closer(p, step);
    if (step.defect <= limits_.tolerance || rounding) {
      find_event(mode, free, step);
      const bool known = y_is_known(step);
      if (!known) sign_is_lost_ = true;
      return known;
    }
    if (h < shortest_share * T_) return false;
    before = step.defect;
    shortened = true;
    const double shorter =
        std::isfinite(step.defect)
            ? std::clamp(0.9 * std::pow(limits_.tolerance / step.defect, 1.0 / double(degree)), 0.1, 0.7)
            : 0.1;
    h = propagators_.grid_length(shorter * h);
  }
  return false;
}

}  // namespace bromwich
