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

Scene scene_of(const Batch& b, Index k) {
  if (!b.own.empty()) return b.own[std::size_t(k)];
  Scene scene = b.common;
  put_own_data(b, k, scene);
  return scene;
}

void put_own_data(const Batch& b, Index k, Scene& scene) {
  const std::size_t i = std::size_t(k);
  if (!b.A.empty() || !b.B.empty() || !b.N.empty() || !b.E.empty()) {
    const DenseDynamics& common = *b.common.dynamics->small_state();
    const auto own = [&](const std::vector<Matrix>& each, const Matrix& shared) -> const Matrix& {
      return each.empty() ? shared : each[i];
    };
    scene.dynamics = DenseDynamics{own(b.A, common.A), own(b.B, common.B), own(b.N, common.N), own(b.E, common.E)};
  }
  if (!b.M.empty()) scene.M = b.M[i];
  if (b.x0.size() > 0) scene.x0 = b.x0.row(k).transpose();
  if (!b.f.empty()) scene.f = b.f[i];
  if (!b.g.empty()) scene.g = b.g[i];
  if (!b.breakpoints.empty()) scene.breakpoints = b.breakpoints[i];
  if (!b.f.empty() || !b.g.empty() || !b.breakpoints.empty()) {
    scene.breakpoints_are_all = b.breakpoints_are_all;
    scene.no_pulses = b.no_pulses;
  }
  scene.exact = {};
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
