#pragma once
// What is known of a scene before it is solved, and what a solve with these options would do.

#include "app/output_json.hpp"
#include "app/scene_choice.hpp"
#include "core/result/options.hpp"
#include "core/seam/backend.hpp"

#include <string>
#include <vector>

namespace bromwich::app {

/// A method that a solve tries, and what it is predicted to take.
struct Candidate {
  Method method = Method::automatic;
  double bytes = 0;       ///< memory
  double operations = 0;  ///< multiplications, order of magnitude
  double seconds = 0;     ///< order of magnitude
  std::string against;    ///< why it will not be taken, or empty
  std::string remark;     ///< what else is known of it, or empty
};

struct SceneCheck {
  Index constraints = 0, states = 0, steps = 0, free_rows = 0;
  double T = 0;
  double tolerance = 0;  ///< of a solve with these options; 0: it takes `steps`, otherwise predictions are for them
  std::string dynamics, mass, matrix_class, spectrum, start, sources;
  std::vector<double> breakpoints;     ///< stated, or found by looking at the sources
  std::vector<Candidate> candidates;   ///< in the order in which they are tried
  std::vector<std::string> nonlinear;  ///< what is known of phi and gamma, of files with [nonlinear]
  std::vector<std::string> warnings;
  std::string refusal;  ///< why the scene will not be solved, or empty
};

SceneCheck check_scene(const SceneChoice&, Backend&, const Options&);

/// The text output of `check`, and its object, schema "bromwich-check/1".
std::string check_text(const SceneChoice&, const SceneCheck&);
Json check_json(const SceneChoice&, const SceneCheck&);

}  // namespace bromwich::app
