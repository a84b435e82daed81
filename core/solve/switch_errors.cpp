#include "core/solve/switch_errors.hpp"

#include "core/base/error.hpp"
#include "core/result/result.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace bromwich {

namespace {

std::optional<Result> on_another_grid(const Scene& scene, Backend& backend, const Options& options,
                                      const Result& result, Index steps) {
  if (steps < 1) return std::nullopt;
  Options other = options;
  other.method = result.method;
  other.steps = steps;
  other.tolerance = 0;
  other.states = StateSelection::none;
  other.components.clear();
  other.trace = false;
  other.tuning.first_iterate = nullptr;
  try {
    Result coarse = solve(scene, backend, other);
    if (coarse.status == Status::solved) return coarse;
  } catch (const Error& error) {  // a grid that the method refuses shows nothing
    if (error.kind() == ErrorKind::device || error.kind() == ErrorKind::internal) throw;
  }
  return std::nullopt;
}

}  // namespace

std::vector<Switch> switches_with_errors(const Scene& scene, Backend& backend, const Options& options,
                                         const Result& result) {
  std::vector<Switch> found = switches(result);
  if (found.empty() || result.goal || result.located) return found;
  const double h = scene.T / double(result.steps);
  std::vector<double> apart(found.size(), 0);
  for (const Index steps : {result.steps / 2, result.steps * 3 / 4}) {
    const auto coarse =
        result.status == Status::solved ? on_another_grid(scene, backend, options, result, steps) : std::nullopt;
    const std::vector<double> from = coarse ? distances(found, switches(*coarse), h) : std::vector(found.size(), h);
    for (std::size_t k = 0; k < found.size(); ++k) apart[k] = std::max(apart[k], from[k]);
  }
  // Steps of first order differ from twice as long ones by no more than their own error, those of second order by three
  // times that.
  const bool euler = by_euler(result);
  const bool may_jump = euler || (!result.continuous && result.y_left.size() == 0);
  for (std::size_t k = 0; k < found.size(); ++k)
    found[k].error = std::max(found[k].error + (euler ? 2 : 1) * apart[k], may_jump ? h / 2 : 0);
  return found;
}

}  // namespace bromwich
