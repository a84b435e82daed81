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
constexpr Index fewest_to_halve = 16, few_steps = 256;
constexpr double looked_into = 0.02;        ///< error of half the steps, as far as it is seen
constexpr double seen_by_grids = 0.04;      ///< error of the steps that is told
constexpr double counts_as_nothing = 1e-8;  ///< in natural units
constexpr double most_ratio = 0.5;          ///< of the last difference to the one before, at most

struct ErrorsOfSteps {
  double x = 0, y = 0;  ///< y: of the mean, if there are impulses
  double rows_of_y = 0;
  double largest() const { return std::max({x, y, rows_of_y}); }
};

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
  const bool euler = by_euler(method, result);
  if (!options_.confirm || (result.continuous && !euler && !p.sources)) return;
  const bool affordable = !p.modes() && double(p.scene.states()) * double(p.J) <= most_compared_values;
  if (!affordable || p.scene.constraints() > most_compared_constraints || p.J < fewest_to_halve || p.J % 2 != 0) return;
  std::string cause;
  const bool impulses = result.starts_with_impulse || result.euler_steps > 0;
  if (impulses)
    cause = "the state jumps";
  else if (p.sources)
    cause = "sources jump or change fast inside steps";
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
    const bool fewer = steps < p.J;
    const Result &coarse = fewer ? r : result, &fine = fewer ? result : r;
    const Distance d = distance(coarse, 1, fine, 2, sizes);
    // Rows of an impulse have its mean over a step: its integral counts.
    return ErrorsOfSteps{d.of_x(), impulses ? d.mean : d.y, d.y};
  };
  const bool few = p.J <= few_steps;
  ErrorsOfSteps half, twice;
  if (!few && (half = apart(p.J / 2)).largest() <= looked_into) return;
  if (few && (twice = apart(2 * p.J)).largest() <= (1 - most_ratio) * seen_by_grids) return;
  few ? half = apart(p.J / 2) : twice = apart(2 * p.J);
  const StepErrors errors{error_by_ratio(half.x, twice.x), error_by_ratio(half.y, twice.y), impulses};
  if (std::max(errors.x, errors.y) > seen_by_grids) tell_errors(errors, result);
}

}  // namespace bromwich
