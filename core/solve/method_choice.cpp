#include "core/solve/method_choice.hpp"

#include "core/lcp/lcp_class.hpp"
#include "core/multigrid/time_levels.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double largest_device_march = 1024;  ///< constraints
constexpr double smallest_on_device = 1e4;     ///< values n J, for methods that solve all time points at once

bool is_fitted(const Scene& scene, LcpClass lcp_class) {
  return std::holds_alternative<KroneckerDynamics>(scene.dynamics) && lcp_class == LcpClass::P && !scene.boundary &&
         scene.free_rows.empty();
}

// A device makes at least two of them.
bool has_coarse_grids(Index J) { return J % 4 == 0 && J / 4 >= fewest_steps_on_device; }

double milliseconds_on_device(Method method, double n, double J) {
  const double sweeps = 10 + 0.6 * n;
  switch (method) {
    case Method::march:
      return n > largest_device_march ? INFINITY : 0.5 + 0.017 * n + 2.8e-5 * n * n + 1e-5 * n * J + 2.4e-3 * J;
    case Method::contour:
      return 0.8 + 1.5e-6 * n * J + 1.9e-4 * J + sweeps * (0.042 + 3.9e-8 * n * J);
    case Method::multigrid:
      return has_coarse_grids(Index(J)) ? (0.32 + 2.5e-3 * n) * std::log2(J) + 2e-6 * n * J + 8.5e-5 * J : INFINITY;
    default:
      return INFINITY;
  }
}

}  // namespace

double predicted_seconds(const Scene& scene, LcpClass lcp_class, Method method, Index J, bool on_device) {
  if (!is_fitted(scene, lcp_class)) return INFINITY;
  const double n = double(scene.constraints()), steps = double(J);
  if (on_device) return 1e-3 * milliseconds_on_device(method, n, steps);
  return method == Method::march ? 1e-3 * (0.013 * n + 1.2e-4 * n * n + 3.4e-5 * n * steps + 6e-4 * steps) : INFINITY;
}

std::vector<Method> methods_by_time(const Scene& scene, LcpClass lcp_class, Index J, bool on_device) {
  std::vector<Method> methods{Method::march, Method::contour};
  if (on_device && is_fitted(scene, lcp_class) && has_coarse_grids(J)) methods.push_back(Method::multigrid);
  std::stable_sort(methods.begin(), methods.end(), [&](Method a, Method b) {
    return predicted_seconds(scene, lcp_class, a, J, on_device) < predicted_seconds(scene, lcp_class, b, J, on_device);
  });
  methods.push_back(Method::euler);
  return methods;
}

bool faster_on_device(const Scene& scene, Method method, Index J, bool started) {
  const LcpClass lcp_class = scene.lcp_class == LcpClass::automatic ? classify(scene.M) : scene.lcp_class;
  if (!is_fitted(scene, lcp_class)) return false;
  if (method == Method::contour || method == Method::multigrid)
    return double(J) * double(scene.constraints()) >= smallest_on_device;
  if (method != Method::march && method != Method::automatic) return false;
  const Method best = method == Method::march ? method : methods_by_time(scene, lcp_class, J, true).front();
  return predicted_seconds(scene, lcp_class, best, J, true) + (started ? 0 : device_start_seconds) <
         predicted_seconds(scene, lcp_class, Method::march, J, false);
}

}  // namespace bromwich
