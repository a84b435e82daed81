#include "core/scene/component_names.hpp"

#include <algorithm>

namespace bromwich {

namespace {

std::string label(const std::vector<std::string>& given, char letter, Index component) {
  return std::size_t(component) < given.size() ? given[std::size_t(component)] : letter + std::to_string(component);
}

}  // namespace

std::string state_name(const Scene& scene, Index component) { return label(scene.names.x, 'x', component); }
std::string multiplier_name(const Scene& scene, Index component) { return label(scene.names.y, 'y', component); }
std::string slack_name(const Scene& scene, Index component) { return label(scene.names.w, 'w', component); }

Index find_state(const Scene& scene, const std::string& name) {
  const auto found = std::find(scene.names.x.begin(), scene.names.x.end(), name);
  if (found != scene.names.x.end()) return found - scene.names.x.begin();
  for (Index i = 0; name.starts_with('x') && i < scene.states(); ++i)
    if (name == "x" + std::to_string(i)) return i;
  return -1;
}

}  // namespace bromwich
