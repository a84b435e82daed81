#include "app/scene_facts.hpp"

#include "core/dynamics/spectrum.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/solve/mixed.hpp"

namespace bromwich::app {

namespace {

constexpr Index most_states = 400;  ///< above, all eigenvalues of a dense matrix take more than a second

}  // namespace

std::string matrix_class(const Scene& scene) {
  if (scene.constraints() == 0) return "no constraints";
  if (const auto eliminated = scene.free_rows.empty() ? std::nullopt : eliminate_free(scene))
    return matrix_class(eliminated->scene) + ", free rows eliminated";
  return describe_class(scene.M, known_class(scene.M, scene.lcp_class));
}

std::string spectrum_text(const Scene& scene) {
  if (scene.dynamics->has_mass() && scene.dynamics->has_singular_mass()) return "none: E is singular";
  const bool small = !scene.dynamics->small_state() || scene.states() <= most_states;
  return small ? spectrum(scene.dynamics).describe() : "not computed";
}

}  // namespace bromwich::app
