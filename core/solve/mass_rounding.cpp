#include "core/solve/mass_rounding.hpp"

#include "core/numerics/equilibration.hpp"
#include "core/result/notice.hpp"
#include "core/scene/mass_matrix.hpp"
#include "core/solve/error_goal.hpp"
#include "core/solve/reductions.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double roundings = 1;            ///< of an entry
constexpr double seen_on_one_grid = 1e-4;  ///< of a component: what is reported without a tolerance

double reciprocal_condition_of(const Matrix& E) {
  return reciprocal_condition(Eigen::PartialPivLU<Matrix>(scaled(E, equilibrate(E))));
}

// Signs without a pattern that the structure of E could share.
Scene with_rounded_mass(const DenseDynamics& d, Scene scene) {
  DenseDynamics other = d;
  std::uint64_t state = 0x9E3779B97F4A7C15u;
  for (double& entry : other.E.reshaped()) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    entry *= 1 + (state >> 63 ? roundings : -roundings) * epsilon;
  }
  scene.dynamics = std::move(other);
  return scene;
}

// At the time points that both have.
std::optional<Distance> apart(const Result& a, const Result& b, const ComponentSizes& sizes) {
  if (a.y.cols() != b.y.cols() || a.x.cols() != b.x.cols()) return std::nullopt;
  const Index least = std::min(a.steps, b.steps);
  if (least == 0 || a.steps % least != 0 || b.steps % least != 0) return std::nullopt;
  return distance(a, a.steps / least, b, b.steps / least, sizes);
}

}  // namespace

void add_rounding_of_mass(const Scene& scene, Backend& backend, const InnerOptions& options, Result& result) {
  if (!scene.dynamics->has_mass() || result.status != Status::solved || result.goal) return;
  if (scene.dynamics->matrices() && becomes_dense(scene, options))
    return add_rounding_of_mass(written_out(scene), backend, options, result);
  const DenseDynamics* d = scene.dynamics->small_state();
  if (!d) return;
  const double condition = reciprocal_condition_of(d->E);
  if (!(condition < nearly_singular_mass)) return;
  InnerOptions again = options;
  again.prepared = {};
  again.progress = {};
  again.log = {};
  const Scene rounded = with_rounded_mass(*d, scene);
  const auto without = rounded.dynamics->has_singular_mass() ? std::nullopt : without_mass(rounded);
  const Result other = without ? solve_valid(*without, backend, again) : Result{};
  if (other.status == Status::interrupted) return;
  const ErrorGoal goal(options);
  const auto distance = other.status == Status::solved ? apart(result, other, sizes_for(scene, options)) : std::nullopt;
  const bool mean = !result.continuous || (result.errors && result.errors->of_integral);
  const double of_y = distance ? (mean ? distance->mean : distance->y) : INFINITY;
  const double of_x = distance ? distance->of_x() : INFINITY;
  const Notice notice{NoticeCode::mass_matrix, condition, std::max(of_y, of_x)};
  if (!controls_error(options)) {
    if (!(notice.other <= seen_on_one_grid)) tell(result, notice);
    return;
  }
  ErrorEstimate& e = *result.errors;
  const double y = goal.y > 0 ? of_y : 0, x = goal.x > 0 && result.x.cols() > 0 ? of_x : 0;
  e.rounding += y;
  e.states += x;
  if (result.error_estimate) *result.error_estimate += std::max(y, x);
  if (y <= goal.y && x <= goal.x) return;
  result.status = Status::tolerance_not_met;
  result.reason = sentence({notice.code, condition, std::max(y, x)});
}

}  // namespace bromwich
