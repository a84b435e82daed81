#include "core/events/event_step.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index degree = Collocation::degree;
constexpr double rounding_tail = 1e-10;   ///< of last coefficients: below, rounding is the cause where it stays
constexpr double noise_share = 10;        ///< of the tolerance: negative values below count as zero
constexpr double unseen = 1e-3;           ///< of the state: what rounding of y may move
constexpr double shortest_share = 1e-14;  ///< of T
constexpr double of_source = 100;         ///< one value of one component of a source, in floating-point operations
constexpr double overhead = 4000;         ///< of a step, likewise

// Coefficients of the part of rows of a jet that does not depend on x.
void without_x(const Jet& rows, const EventStep& p, LegendreCoefficients& sum) {
  sum.noalias() = p.sources.f * rows.f.transpose();
  sum.noalias() += p.sources.g * rows.g.transpose();
  if (p.df.size() > 0) sum.noalias() += p.df * rows.df.transpose();
  if (p.dg.size() > 0) sum.noalias() += p.dg * rows.dg.transpose();
  if (p.ddg.size() > 0) sum.noalias() += p.ddg * rows.ddg.transpose();
}

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

// Coefficients of Legendre polynomials bound the values.
auto largest(const LegendreCoefficients& c) { return c.cwiseAbs().colwise().sum().transpose(); }

void set_larger(const Vector& before, const LegendreCoefficients& c, Vector& size) {
  size = before;
  if (c.size() > 0) size = size.cwiseMax(largest(c));
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

// Bounds the derivatives on [0, 1] times `by`.
void add_largest_slope(const LegendreCoefficients& c, double by, Vector& sum) {
  for (Index i = 0; i < c.cols(); ++i) sum[i] += by * (Collocation::get().derivative * c.col(i)).cwiseAbs().sum();
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

// Whether a polynomial is nowhere above `zero` before `at`, where it is below -zero.
bool is_never_above(const LegendreValues& coefficients, double at, double zero) {
  constexpr int looks = 16;
  for (int k = 0; k < looks; ++k)
    if (coefficients.dot(legendre(at * k / looks)) > zero) return false;
  return true;
}

}  // namespace

void EventSizes::set_with(const EventSizes& before, const EventStep& step) {
  set_larger(before.u.x, step.x, u.x);
  set_larger(before.u.f, step.sources.f, u.f);
  set_larger(before.u.df, step.df, u.df);
  set_larger(before.u.g, step.sources.g, u.g);
  set_larger(before.u.dg, step.dg, u.dg);
  set_larger(before.u.ddg, step.ddg, u.ddg);
  set_larger(before.y, step.y, y);
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
      rigid_((openings(system).array() > 0).any()) {
  begin(limits);
}

void EventSteps::begin(const StepLimits& limits) {
  sign_is_lost_ = false;
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
  without_x(mode.constraints, step, off_);
  off_.noalias() += step.x * mode.constraints.x.transpose();
  off_.row(0) -= legendre(0).transpose() * off_;
  step.x.noalias() -= off_ * mode.onto.transpose();
}

void EventSteps::attempt(const SwitchedMode& mode, EventPoint& p, double h, EventStep& step) {
  const Collocation& c = Collocation::get();
  const Index m = system_.states(), n = system_.constraints();
  step.length = h;
  sample(mode, p.t, h, step);
  without_x(mode.y, step, y_of_sources_);
  input_ = step.sources.f;
  input_.noalias() += y_of_sources_ * system_.B.transpose();
  input_.row(0).noalias() += p.x.transpose() * mode.A.transpose();
  const LegendreCoefficients& whole = propagators_.move(mode, h, input_, step.x, p.work);
  step.x.row(0) += p.x.transpose();
  if (!rigid_ && mode.constraints.x.rows() > 0) hold_constraints(mode, step);
  step.y = y_of_sources_;
  step.y.noalias() += step.x * mode.y.x.transpose();
  step.w = step.sources.g;
  step.w.noalias() += step.x * system_.N.transpose();
  step.w.noalias() += step.y * system_.M.transpose();
  step.sizes.set_with(p.sizes, step);
  set_zeros(mode, p, step);
  const JetValues& size = step.sizes.u;
  step.defect = std::max({tail(whole, size.x, {}, rounding_of_x(step.sizes, h)), source_defect(size, step.sources),
                          defect_of_signs(mode, step)});
  p.work +=
      double((degree + 1) * (degree + 1) * (6 * m + 3 * n) + 80 * m * m + (degree + 1) * (4 * m * n + 2 * n * n)) +
      overhead;
  p.work += double(c.samples.size() + c.checks.size()) * work_of_sources();
}

// Whether the conditions of the mode on f and g hold on the step.
bool EventSteps::sources_agree(const SwitchedMode& mode, const JetValues& size, const EventStep& step) const {
  if (mode.conditions.g.rows() == 0) return true;
  LegendreCoefficients values;
  without_x(mode.conditions, step, values);
  const Vector off = largest(values);
  return !((off - 30 * noise() * terms(mode.condition_terms, size)).array() > 0).any();
}

// Whether values of y that count as zero move the state between two breakpoints, where their sign is chosen anew, by
// less than `unseen` of it, or of what y moves: otherwise terms of y cancel so far, by a small entry of M say, that its
// sign is not known.
bool EventSteps::y_is_known(const EventStep& step) const {
  const JetValues& size = step.sizes.u;
  const auto most = [](const auto& product) { return Vector(product).maxCoeff(); };
  const double moved = most(by_y_within_span_ * step.zero_y);
  return moved <= unseen * size.x.maxCoeff() || moved <= unseen * most(by_f_within_span_ * size.f) ||
         moved <= unseen * most(by_y_within_span_ * Vector(largest(step.y)));
}

Vector EventSteps::rounding_of_x(const EventSizes& sizes, double length) const {
  Vector moved = by_f_within_step_ * sizes.u.f;
  moved.noalias() += by_y_within_step_ * sizes.y;
  moved *= 64 * epsilon * longer_than_usual(length);
  return moved;
}

// Negative values that count as zero are of a solution nearby. Where that is another one, with y_i > 0 and w_i = 0,
// y_i is about -w_i / M_ii. Without M_ii it would move the state, and its error is that of x.
void EventSteps::set_doubt(const SwitchedMode& mode, EventStep& step) const {
  const Collocation& c = Collocation::get();
  Vector& off = step.doubt;
  off.setZero(system_.constraints());
  std::size_t k = 0;
  for (Index i = 0; i < off.size(); ++i) {
    const bool active = k < mode.active.size() && mode.active[k] == i;
    if (active) ++k;
    if (!active && !(system_.M(i, i) > 0)) continue;
    const Eigen::Matrix<double, degree, 1> values = c.stages * (active ? step.y : step.w).col(i);
    for (Index j = 0; j < values.size() && c.nodes[j] <= step.valid; ++j) off[i] = std::max(off[i], -values[j]);
    off[i] = std::max(0.0, off[i] - (active ? step.rounding_y : step.rounding_w)[i]) / (active ? 1 : system_.M(i, i));
  }
}

// Rounding of u on a step: of the values there, of x' in a state that its terms hold at zero, and of the derivatives of
// sources. What has decayed to eps^2 of its largest value is zero.
void EventSteps::set_rounding(const EventStep& step) {
  static const double steepest = Collocation::get().derivative.cwiseAbs().colwise().sum().maxCoeff();
  const auto& [f, g, off_f, off_g, unknown_f, unknown_g] = step.sources;
  const double grown = steepest / step.length;
  JetValues& u = rounding_;
  u.f = largest(f);
  u.g = largest(g);
  terms_y_ = largest(step.y);
  u.x.noalias() = by_f_within_step_ * u.f;
  u.x.noalias() += by_y_within_step_ * terms_y_;
  u.x *= longer_than_usual(step.length);
  u.x += largest(step.x);
  u.x = 64 * epsilon * u.x + epsilon * epsilon * step.sizes.u.x;
  u.df = grown * (4 * epsilon * u.f + unknown_f);
  u.dg = grown * (4 * epsilon * u.g + unknown_g);
  u.ddg = grown * u.dg;
  u.f = 64 * epsilon * u.f + unknown_f;
  u.g = 64 * epsilon * u.g + unknown_g;
}

// What counts as zero of y and w: their rounding, what changes within that of t, and the error of a resolved polynomial
// beside its own size on the step.
void EventSteps::set_zeros(const SwitchedMode& mode, const EventPoint& p, EventStep& step) {
  const JetValues& size = step.sizes.u;
  set_rounding(step);
  const double of_t = 4 * epsilon * T_ / step.length;
  set_terms(mode.y, rounding_, terms_y_);
  step.rounding_y = terms_y_;
  add_largest_slope(step.y, of_t, step.rounding_y);
  step.rounding_w = rounding_.g;
  step.rounding_w.noalias() += system_.N.cwiseAbs() * rounding_.x;
  step.rounding_w.noalias() += system_.M.cwiseAbs() * terms_y_;
  add_largest_slope(step.w, of_t, step.rounding_w);
  // Of rigid contacts beside the largest terms so far: bounces that are lower end.
  if (rigid_) {
    step.zero_y = step.rounding_y + noise() * terms(mode.y, size);
    step.zero_w = step.rounding_w + noise() * terms(mode.w, size);
    return;
  }
  step.zero_y = step.rounding_y + noise() * largest(step.y);
  step.zero_w = step.rounding_w + noise() * largest(step.w);
  // w that the mode holds at zero is zero, and what counted as zero at the end of the step before still does.
  for (const Index i : mode.active) step.zero_w[i] = std::max(step.zero_w[i], step.w.col(i).cwiseAbs().sum());
  if (p.zero_w.size() == 0) return;
  const LegendreValues at = legendre(0);
  const auto keep = [&at](Vector& zero, const Vector& before, const Vector& rounding,
                          const LegendreCoefficients& values) {
    for (Index i = 0; i < zero.size(); ++i)
      zero[i] = std::max(zero[i], std::min(before[i] + rounding[i], -values.col(i).dot(at)));
  };
  keep(step.zero_y, p.zero_y, step.rounding_y, step.y);
  keep(step.zero_w, p.zero_w, step.rounding_w, step.w);
}

// Last coefficients of y and w beside their own sizes on the step, where their sign may depend on them.
double EventSteps::defect_of_signs(const SwitchedMode& mode, const EventStep& step) const {
  if (rigid_) return 0;
  const Collocation& c = Collocation::get();
  double defect = 0;
  std::size_t k = 0;
  for (Index i = 0; i < system_.constraints(); ++i) {
    const bool active = k < mode.active.size() && mode.active[k] == i;
    if (active) ++k;
    const LegendreValues of_sign = (active ? step.y : step.w).col(i);
    const double last = std::abs(of_sign[degree]) + std::abs(of_sign[degree - 1]);
    const double unknown = last - (active ? step.rounding_y : step.rounding_w)[i];
    if (!(unknown > 0) || (c.bernstein * of_sign).minCoeff() > 4 * last) continue;
    defect = std::max(defect, unknown / of_sign.cwiseAbs().sum());
  }
  return defect;
}

// The part of the step on which y and w are nonnegative.
void EventSteps::find_event(const SwitchedMode& mode, const std::vector<char>* free, EventStep& step) const {
  const Collocation& c = Collocation::get();
  const JetValues& size = step.sizes.u;
  if (!sources_agree(mode, size, step)) {
    step.valid = 0;
    step.event = mode.active.front();
    step.at_once = true;
    step.doubt.setZero(system_.constraints());
    return;
  }
  step.valid = 1;
  step.event = -1;
  step.at_once = false;
  LegendreValues of_event;
  double zero_of_event = 0;
  std::size_t k = 0;
  for (Index i = 0; i < system_.constraints(); ++i) {
    const bool active = k < mode.active.size() && mode.active[k] == i;
    if (active) ++k;
    if (free && (*free)[std::size_t(i)]) continue;
    const double zero = (active ? step.zero_y : step.zero_w)[i] + 1e-290;
    const LegendreValues coefficients = (active ? step.y : step.w).col(i);
    const double at = first_below(c.bernstein * coefficients, zero);
    if (at >= step.valid) continue;
    step.valid = at;
    step.event = i;
    of_event = coefficients;
    zero_of_event = zero;
  }
  if (step.event >= 0) step.at_once = is_never_above(of_event, step.valid, zero_of_event);
  if (step.event >= 0 && step.valid > 0) step.valid = zero_before(of_event, step.valid);
  set_doubt(mode, step);
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
