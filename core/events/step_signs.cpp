// What counts as zero of y and w on a step, and where one of them becomes negative.
#include "core/events/event_step.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index degree = Collocation::degree;
constexpr double unseen = 1e-3;  ///< of the state: what rounding of y may move

// Bounds the derivatives on [0, 1] times `by`.
void add_largest_slope(const LegendreCoefficients& c, double by, Vector& sum) {
  for (Index i = 0; i < c.cols(); ++i) sum[i] += by * (Collocation::get().derivative * c.col(i)).cwiseAbs().sum();
}

// Whether a polynomial is nowhere above `zero` before `at`, where it is below -zero.
bool is_never_above(const LegendreValues& coefficients, double at, double zero) {
  constexpr int looks = 16;
  for (int k = 0; k < looks; ++k)
    if (coefficients.dot(legendre(at * k / looks)) > zero) return false;
  return true;
}

}  // namespace

// Whether the conditions of the mode on f and g hold on the step.
bool EventSteps::sources_agree(const SwitchedMode& mode, const JetValues& size, const EventStep& step) const {
  if (mode.conditions.g.rows() == 0) return true;
  LegendreCoefficients values;
  step.set_without_x(mode.sum_conditions, mode.conditions.g.rows(), values);
  const Vector off = bounds(values);
  return !((off - 30 * noise() * terms(mode.condition_terms, size)).array() > 0).any();
}

// Whether values of y that count as zero move the state between two breakpoints, where their sign is chosen anew, by
// less than `unseen` of it, or of what y moves: otherwise terms of y cancel so far, by a small entry of M say, that its
// sign is not known.
bool EventSteps::y_is_known(const EventStep& step) const {
  const JetValues& size = step.sizes.u;
  const auto most = [this](const Matrix& by, const auto& values) {
    return (moved_.noalias() = by * values).maxCoeff();
  };
  const double moved = most(by_y_within_span_, step.zero_y);
  if (moved <= unseen * size.x.maxCoeff() || moved <= unseen * most(by_f_within_span_, size.f)) return true;
  return moved <= unseen * most(by_y_within_span_, Vector(bounds(step.y)));
}

// Rounding of u on a step: of the values there, of x' in a state that its terms hold at zero, and of the derivatives of
// sources. What has decayed to eps^2 of its largest value is zero.
void EventSteps::set_rounding(const EventStep& step) {
  static const double steepest = Collocation::get().derivative.cwiseAbs().colwise().sum().maxCoeff();
  const auto& [f, g, off_f, off_g, unknown_f, unknown_g] = step.sources;
  const double grown = steepest / step.length;
  JetValues& u = rounding_;
  u.f = bounds(f);
  u.g = bounds(g);
  terms_y_ = bounds(step.y);
  set_rounding_of_x(u.f, terms_y_, step.length, u.x);
  u.x += 64 * epsilon * bounds(step.x) + epsilon * epsilon * step.sizes.u.x;
  u.df = grown * unknown_f;
  u.dg = grown * unknown_g;
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
  terms_y_.setZero();
  mode.sum_y.add_terms(rounding_, terms_y_);
  step.rounding_y = terms_y_;
  add_largest_slope(step.y, of_t, step.rounding_y);
  step.rounding_w = rounding_.g;
  N_.add_terms(rounding_.x, step.rounding_w);
  M_.add_terms(terms_y_, step.rounding_w);
  add_largest_slope(step.w, of_t, step.rounding_w);
  // Of rigid contacts beside the largest terms so far: bounces that are lower end.
  if (rigid_) {
    step.zero_y = step.rounding_y + noise() * terms(mode.y, size);
    step.zero_w = step.rounding_w + noise() * terms(mode.w, size);
    return;
  }
  step.zero_y = step.rounding_y + noise() * bounds(step.y);
  step.zero_w = step.rounding_w + noise() * bounds(step.w);
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

}  // namespace bromwich
