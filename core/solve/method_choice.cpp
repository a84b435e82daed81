#include "core/solve/method_choice.hpp"

#include "core/lcp/lcp_class.hpp"
#include "core/scene/scene.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

bool is_fitted(const Scene& scene, LcpClass lcp_class) {
  return scene.dynamics->modes() && has_one_solution(lcp_class) && !scene.boundary && scene.free_rows.empty();
}

// Two of them at least.
bool has_coarse_grids(const BackendTraits& traits, Index J) { return J % 4 == 0 && J / 4 >= traits.fewest_steps; }

Milliseconds fit(const BackendTraits& traits, bool on_face, Method method, Index J) {
  if (on_face) {
    if (method == Method::march) return traits.face_march;
    if (method == Method::contour) return traits.face_contour;
    return method == Method::multigrid && has_coarse_grids(traits, J) ? traits.face_multigrid : nullptr;
  }
  if (method == Method::march) return traits.march;
  if (method == Method::contour) return traits.contour;
  return method == Method::multigrid && has_coarse_grids(traits, J) ? traits.multigrid : nullptr;
}

}  // namespace

double predicted_seconds(const BackendTraits& traits, const Scene& scene, LcpClass lcp_class, Method method, Index J) {
  if (!is_fitted(scene, lcp_class)) return INFINITY;
  const Milliseconds milliseconds = fit(traits, !scene.dynamics->modes()->beside.empty(), method, J);
  if (!milliseconds) return INFINITY;
  return 1e-3 * milliseconds(double(scene.constraints()), double(J));
}

std::vector<Method> methods_by_time(const BackendTraits& traits, const Scene& scene, LcpClass lcp_class, Index J) {
  std::vector<Method> methods{Method::march, Method::contour};
  const auto seconds = [&](Method method) { return predicted_seconds(traits, scene, lcp_class, method, J); };
  if (std::isfinite(seconds(Method::multigrid))) methods.push_back(Method::multigrid);
  std::stable_sort(methods.begin(), methods.end(), [&](Method a, Method b) { return seconds(a) < seconds(b); });
  methods.push_back(Method::euler);
  return methods;
}

bool faster_on_device(const BackendTraits& device, const BackendTraits& host, const Scene& scene, Method method,
                      Index J, bool started) {
  const LcpClass lcp_class = known_class(scene.M, scene.lcp_class);
  if (!is_fitted(scene, lcp_class)) return false;
  if (method == Method::contour || method == Method::multigrid)
    return double(J) * double(scene.constraints()) >= device.fewest_values;
  if (method != Method::march && method != Method::automatic) return false;
  const Method best = method == Method::march ? method : methods_by_time(device, scene, lcp_class, J).front();
  return predicted_seconds(device, scene, lcp_class, best, J) + (started ? 0 : device.start_seconds) <
         predicted_seconds(host, scene, lcp_class, Method::march, J);
}

}  // namespace bromwich
