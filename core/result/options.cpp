#include "core/result/options.hpp"

#include "core/scene/scene.hpp"

#include <algorithm>
#include <iterator>
#include <numeric>

namespace bromwich {

bool controls_error(const Options& o) {
  return o.tolerance > 0 || o.tolerance_x > 0 || o.tolerance_y > 0 || o.absolute_tolerance > 0;
}

double default_tolerance(const Scene& scene) {
  constexpr double otherwise = 1e-3;
  if (scene.default_tolerance > 0) return scene.default_tolerance;
  return scene.default_steps > 0 ? 0 : otherwise;
}

Options with_defaults(Options options, const Scene& scene) {
  const bool one_grid = options.method == Method::goal || options.event_location || !options.confirm;
  const double named[] = {double(options.steps), options.tolerance, options.tolerance_x, options.tolerance_y,
                          options.absolute_tolerance};
  const bool none = std::all_of(std::begin(named), std::end(named), [](double value) { return value == 0; });
  if (none && !one_grid) options.tolerance = default_tolerance(scene);
  return options;
}

Index steps_of(const Scene& scene, const Options& options) { return options.steps > 0 ? options.steps : scene.steps(); }

std::vector<Index> recorded_components(const Scene& scene, const Options& options) {
  if (options.states == StateSelection::list) return options.components;
  std::vector<Index> all(options.states == StateSelection::all ? std::size_t(scene.states()) : 0);
  std::iota(all.begin(), all.end(), Index(0));
  return all;
}

}  // namespace bromwich
