#include "core/result/options.hpp"

#include "core/scene/scene.hpp"

#include <numeric>

namespace bromwich {

bool controls_error(const Options& o) {
  return o.tolerance > 0 || o.tolerance_x > 0 || o.tolerance_y > 0 || o.absolute_tolerance > 0;
}

std::vector<Index> recorded_components(const Scene& scene, const Options& options) {
  if (options.states == StateSelection::list) return options.components;
  std::vector<Index> all(options.states == StateSelection::all ? std::size_t(scene.states()) : 0);
  std::iota(all.begin(), all.end(), Index(0));
  return all;
}

}  // namespace bromwich
