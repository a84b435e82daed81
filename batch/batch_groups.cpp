#include "batch/batch_groups.hpp"

#include "core/scene/natural_sizes.hpp"
#include "core/solve/kept_solver.hpp"

#include <algorithm>
#include <functional>
#include <map>
#include <utility>

namespace bromwich {

namespace {

// Equal for dense dynamics with equal values; others are told apart by their place.
std::size_t hash_of(const Dynamics& dynamics) {
  const DenseDynamics* dense = dynamics->small_state();
  if (!dense) return std::hash<const void*>()(&*dynamics);
  std::size_t hash = 0;
  for (const Matrix* matrix : {&dense->A, &dense->B, &dense->N, &dense->E})
    for (Index k = 0; k < matrix->size(); ++k) hash = hash * 1099511628211u + std::hash<double>()(matrix->data()[k]);
  return hash;
}

}  // namespace

bool own_matrices(const Batch& b) {
  return !b.A.empty() || !b.B.empty() || !b.N.empty() || !b.M.empty() || !b.E.empty();
}
bool own_sources(const Batch& b) {
  if (b.own.empty()) return !b.f.empty() || !b.g.empty() || !b.breakpoints.empty();
  if (b.same_sources && std::all_of(b.own.begin(), b.own.end(), [&](const Scene& s) { return s.T == b.own[0].T; }))
    return false;
  return std::any_of(b.own.begin(), b.own.end(), [](const Scene& s) { return s.f || s.g; });
}

Scene with_constant_sources(Scene scene) {
  const auto constant = [](const Vector& values) { return [values](double, Eigen::Ref<Vector> v) { v = values; }; };
  if (scene.f) scene.f = constant(largest_values(scene.f, scene.sources(), scene));
  if (scene.g) scene.g = constant(largest_values(scene.g, scene.constraints(), scene));
  return scene;
}

std::vector<std::vector<Index>> groups_of(const Batch& b) {
  std::vector<std::vector<Index>> groups;
  if (b.own.empty() && !own_matrices(b)) {
    groups.emplace_back();
    for (Index k = 0; k < b.scenes; ++k) groups[0].push_back(k);
    return groups;
  }
  if (b.own.empty()) {
    for (Index k = 0; k < b.scenes; ++k) groups.push_back({k});
    return groups;
  }
  std::map<std::pair<std::size_t, double>, std::vector<std::size_t>> known;  // groups with these dynamics and T
  for (Index k = 0; k < b.scenes; ++k) {
    const Scene& scene = b.own[std::size_t(k)];
    std::vector<std::size_t>& same = known[{hash_of(scene.dynamics), scene.T}];
    const auto found = std::find_if(same.begin(), same.end(), [&](std::size_t g) {
      return share_preparation(b.own[std::size_t(groups[g].front())], scene);
    });
    if (found != same.end()) {
      groups[*found].push_back(k);
    } else {
      same.push_back(groups.size());
      groups.push_back({k});
    }
  }
  return groups;
}

}  // namespace bromwich
