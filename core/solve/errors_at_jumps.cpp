// The error of given steps where y or the state may jump, and of implicit Euler, from grids of other steps.

#include "core/accuracy/convergence.hpp"
#include "core/accuracy/settled_y.hpp"
#include "core/base/text.hpp"
#include "core/solve/certification.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index most_compared_constraints = 64;
constexpr double most_compared_values = 2e7;  ///< m J, of sparse scenes and Kronecker sums
constexpr Index fewest_to_halve = 16, few_steps = 256;
constexpr double fast_start = 0.1;          ///< of the state: what the first step misses of x'(0) h
constexpr double looked_into = 0.02;        ///< error of half the steps, as far as it is seen
constexpr double worth_a_warning = 0.04;    ///< error of the steps
constexpr double counts_as_nothing = 1e-8;  ///< in natural units
constexpr double most_ratio = 0.5;          ///< of the last difference to the one before, at most

struct ErrorsOfSteps {
  double x = 0, y = 0;  ///< y: of the mean, if there are impulses
  double rows_of_y = 0;
  double largest() const { return std::max({x, y, rows_of_y}); }
};

// Of y, but not by more than of B y (dense scenes): y may be one of several with the same effect.
double apart_in_y(const DiscreteProblem& p, const Result& a, Index a_stride, const Result& b, Index b_stride,
                  const ComponentSizes& sizes) {
  const double own = distance(a, a_stride, b, b_stride, sizes).y;
  if (!p.small_state()) return own;
  const auto rates = [&](const Result& r) {
    Result effect = r;
    effect.x = r.y * p.small_state()->B.transpose();
    return effect;
  };
  return std::min(own, distance(rates(a), a_stride, rates(b), b_stride, sizes).of_x());
}

// Whether the state leaves x0 faster than the first step follows.
bool starts_fast(const DiscreteProblem& p, const RowMatrix& x, const Result& result) {
  const Vector input = state_input(p, result.y).row(1).transpose();
  const Vector x0 = x.row(0).transpose(), moved = x.row(1).transpose() - x0;
  const Vector missed = (p.h * (p.small_state()->A * x0 + input) - moved).cwiseAbs(),
               size = x.cwiseAbs().colwise().maxCoeff().transpose();
  return (missed.array() > fast_start * size.cwiseMax(1e-3 * size.maxCoeff()).array()).any();
}

// Behind switches y is that of the last stage. It does not change with the step, and only its row is affected.
void tell_unsettled_rows(const DiscreteProblem& p, const RowMatrix& settled, Result& result) {
  const UnsettledRows rows = unsettled_rows(result.y, settled, worth_a_warning);
  if (rows.count == 0) return;
  add_warning(result, text("y jumps inside steps: at %ld of %ld time points, just behind a switch, y is off by up to "
                           "%.0f %% of its largest value (first at t = %.6g); its integral and x are not",
                           long(rows.count), long(p.J), 100 * rows.error, p.t[rows.first]));
}

// The error of the steps, if half and twice as many differ from them by these.
double error_by_ratio(double half, double twice) {
  const double ratio = std::isfinite(half) && half > 0 ? std::min(twice / half, most_ratio) : most_ratio;
  return twice / (1 - ratio);
}

}  // namespace

// Impulses, jumps of sources inside steps and fast transients at the start cost given steps their order. Twice as many
// steps tell the error. Where that costs more than a few milliseconds, half as many show at half the work whether it
// matters.
void Certification::estimate_errors_at_jumps(Method method, Result& result) {
  const DiscreteProblem& p = methods_.problem();
  const bool euler = by_euler(method, result), dense = Methods::has_small_dense_state(p.scene);
  const bool stages = dense && !result.continuous && !euler;
  if (result.continuous && !euler && !p.sources) return;
  Result own = result;
  if (dense) own.x = methods_.all_states(method, result);
  if (own.x.rows() != p.J + 1 || !own.x.allFinite()) return;
  if (stages) {
    own.y = settled_y(p, own.x, result);
    tell_unsettled_rows(p, own.y, result);
  }
  if (!options_.confirm) return;
  const bool affordable = dense || (!p.modes() && double(p.scene.states()) * double(p.J) <= most_compared_values);
  if (!affordable || p.scene.constraints() > most_compared_constraints || p.J < fewest_to_halve || p.J % 2 != 0) return;
  std::string cause;
  const bool impulses = result.starts_with_impulse || result.euler_steps > 0;
  if (impulses)
    cause = "the state jumps";
  else if (p.sources)
    cause = "sources jump or change fast inside steps";
  else if (euler && dense && !is_continuous(p.lcp_class))  // elsewhere y is continuous, and first order is expected
    cause = "implicit Euler has order 1";
  else if (dense && !result.continuous && starts_fast(p, own.x, own))
    cause = "the state starts faster than a step follows";
  if (cause.empty()) return;
  ComponentSizes sizes;
  sizes.absolute = counts_as_nothing;
  const auto apart = [&](Index steps) {
    note(options_.log, LogLevel::info, "solved again with %ld steps instead of %ld: %s", long(steps), long(p.J),
         cause.c_str());
    Methods other(p.scene, backend_, steps, p.components, p.sources != nullptr, methods_.family());
    Result r;
    other.run(method, options_, r);
    if (r.status != Status::solved) return ErrorsOfSteps{INFINITY, INFINITY, INFINITY};
    if (dense) r.x = other.all_states(method, r);
    if (stages) r.y = settled_y(other.problem(), r.x, r);
    const bool fewer = steps < p.J;
    const Result &coarse = fewer ? r : own, &fine = fewer ? own : r;
    const Distance d = distance(coarse, 1, fine, 2, sizes);
    const double rows = apart_in_y(p, coarse, 1, fine, 2, sizes);
    // Rows of an impulse have its mean over a step: its integral counts.
    return ErrorsOfSteps{d.of_x(), impulses ? d.mean : rows, rows};
  };
  const bool few = p.J <= few_steps;
  ErrorsOfSteps half, twice;
  if (!few && (half = apart(p.J / 2)).largest() <= looked_into) return;
  if (few && (twice = apart(2 * p.J)).largest() <= (1 - most_ratio) * worth_a_warning) return;
  few ? half = apart(p.J / 2) : twice = apart(2 * p.J);
  std::string parts;
  for (const auto& [what, size] : {std::pair("x", error_by_ratio(half.x, twice.x)),
                                   {impulses ? "the mean of y" : "y", error_by_ratio(half.y, twice.y)}})
    if (size > worth_a_warning) parts += (parts.empty() ? "" : ", ") + text("%s by about %.0f %%", what, 100 * size);
  if (parts.empty()) return;
  add_warning(result, twice.largest() < INFINITY ? "with these steps the result is off: " + parts +
                                                       " of the largest value (" + cause + "); use more steps"
                                                 : cause + ", and twice the steps have no result; use other steps");
}

}  // namespace bromwich
