// The error of given steps where y or the state may jump, and of implicit Euler, from grids of other steps.

#include "core/accuracy/convergence.hpp"
#include "core/base/text.hpp"
#include "core/solve/certification.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index most_compared_constraints = 64;
constexpr double most_compared_values = 2e7;  ///< m J, of sparse scenes and Kronecker sums
constexpr Index fewest_to_halve = 16;
constexpr double fast_start = 0.1;        ///< of the state: what the first step misses of x'(0) h
constexpr double looked_into = 0.02;      ///< error of half the steps, as far as it is seen
constexpr double worth_a_warning = 0.04;  ///< error of the steps
constexpr double first_order = 0.5;       ///< of the last difference to the one before, at most

struct ErrorsOfSteps {
  double x, mean, y;
  double largest() const { return std::max({x, mean, y}); }
};

// Whether the state leaves x0 faster than the first step follows.
bool starts_fast(const DiscreteProblem& p, const RowMatrix& x, const Result& result) {
  const Vector input = state_input(p, result.y.topRows(2)).row(1).transpose();
  const Vector x0 = x.row(0).transpose(), moved = x.row(1).transpose() - x0;
  const Vector missed = (p.h * (p.small_state()->A * x0 + input) - moved).cwiseAbs(),
               size = x.cwiseAbs().colwise().maxCoeff().transpose();
  return (missed.array() > fast_start * size.cwiseMax(1e-3 * size.maxCoeff()).array()).any();
}

// The error of the steps, if half and twice as many differ from them by these.
double error_of(double half, double twice) {
  const double ratio = std::isfinite(half) && half > 0 ? std::min(twice / half, first_order) : first_order;
  return twice / (1 - ratio);
}

}  // namespace

// Impulses, jumps of sources inside steps and fast transients at the start cost given steps their order. Half as many
// steps show at half the work whether that matters, and twice as many then tell the error.
void Certification::estimate_errors_at_jumps(Method method, Result& result) {
  const DiscreteProblem& p = methods_.problem();
  const bool euler = by_euler(method, result), dense = Methods::has_small_dense_state(p.scene);
  if ((result.continuous && !euler) || p.scene.constraints() > most_compared_constraints || p.J < fewest_to_halve ||
      p.J % 2 != 0 || (!dense && double(p.scene.states()) * double(p.J) > most_compared_values))
    return;
  Result own = result;
  if (dense) own.x = methods_.all_states(method, result);
  if (own.x.rows() != p.J + 1 || !own.x.allFinite()) return;
  std::string cause;
  if (result.starts_with_impulse || result.euler_steps > 0)
    cause = "the state jumps";
  else if (p.sources)
    cause = "sources jump or change fast inside steps";
  else if (euler && dense)
    cause = "implicit Euler has order 1";
  else if (dense && starts_fast(p, own.x, own))
    cause = "the state starts faster than a step follows";
  if (cause.empty()) return;
  const auto apart = [&](Index steps) {
    note(options_.log, LogLevel::info, "solved again with %ld steps instead of %ld: %s", long(steps), long(p.J),
         cause.c_str());
    Methods other(p.scene, backend_, steps, p.components, p.sources != nullptr, methods_.family());
    Result r;
    other.run(method, options_, r);
    if (r.status != Status::solved) return ErrorsOfSteps{INFINITY, INFINITY, INFINITY};
    if (dense) r.x = other.all_states(method, r);
    const Distance d = steps < p.J ? distance(r, 1, own, 2) : distance(own, 1, r, 2);
    return ErrorsOfSteps{d.of_x(), d.mean, d.y};
  };
  const ErrorsOfSteps half = apart(p.J / 2);
  if (half.largest() <= looked_into) return;
  const ErrorsOfSteps twice = apart(2 * p.J);
  std::string parts;
  for (const auto& [what, size] : {std::pair("x", error_of(half.x, twice.x)),
                                   {"y", error_of(half.y, twice.y)},
                                   {"the mean of y", error_of(half.mean, twice.mean)}})
    if (size > worth_a_warning) parts += (parts.empty() ? "" : ", ") + text("%s by about %.0f %%", what, 100 * size);
  if (parts.empty()) return;
  add_warning(result, twice.largest() < INFINITY ? "with these steps the result is off: " + parts +
                                                       " of the largest value (" + cause + "); use more steps"
                                                 : cause + ", and twice the steps have no result; use other steps");
}

}  // namespace bromwich
