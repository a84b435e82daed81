#pragma once
// Options of a solve.

#include "../base/types.hpp"
#include "log.hpp"
#include "method.hpp"
#include "tuning.hpp"

#include <functional>
#include <memory>
#include <vector>

namespace bromwich {

struct GoalOptions;  // core/goal/options.hpp

enum class StateSelection { none, all, list };

struct Progress {
  Index iteration = 0;  ///< completed sweeps; with `total` > 0, completed time steps
  double change = 0;    ///< of y in the last sweep
  Index total = 0;      ///< steps of a march, 0 for an iteration
};

struct Options {
  Method method = Method::automatic;
  /// Time steps J; 0 = the scene's default. With a tolerance those of the first grid.
  Index steps = 0;

  /// Error to reach by refining the grid (core/solve/error_control.hpp), 0 = one grid: that of component i is at most
  /// tolerance max(max_t |c_i|, 1e-3 of the largest component of the same kind). For y, and for the recorded states.
  double tolerance = 0;
  double tolerance_x = 0;            ///< for the recorded states in place of `tolerance`; alone: y is not controlled
  double tolerance_y = 0;            ///< for y in place of `tolerance`; alone: the states are not controlled
  double absolute_tolerance = 0;     ///< in the units of the scene; added to what the others allow
  bool control_states = true;        ///< the tolerance is for the recorded states too
  Index max_steps = Index(1) << 20;  ///< of the finest grid that a tolerance may lead to
  double max_seconds = 0;            ///< after which a tolerance leads to no further grid; 0 = no limit

  /// Where the iterations end: largest change of y in a sweep, relative to max(1, |y|). The default is near what
  /// rounding allows.
  double iteration_tolerance = 1e-12;
  Index max_iterations = 2000;  ///< converging scenes need tens to hundreds; others stop earlier by themselves

  StateSelection states = StateSelection::none;  ///< components of x to record at all time points
  std::vector<Index> components = {};            ///< those, from 0, with StateSelection::list
  bool trace = false;                            ///< record N x

  /// Method galerkin: solved again with nodes at the switches of the active sets (core/galerkin/location.hpp).
  bool event_location = false;
  /// Without a tolerance: where something speaks against a result, it is solved again with other steps, and demoted or
  /// warned of where they differ. False: one solve, and the checks that need no other one.
  bool confirm = true;
  std::shared_ptr<const GoalOptions> goal = {};  ///< of method goal; null: its defaults

  double memory_limit = 0;  ///< bytes; a solve that is predicted to need more is refused. 0 = no limit
  std::function<void(const Progress&)> progress = {};  ///< called now and then, with what is done
  std::function<bool()> interrupted = {};              ///< polled in sweeps and marches; true ends the solve
  Log log = {};                                        ///< receives what the solve decides

  Tuning tuning = {};  ///< for studies of the methods
};

/// Whether any of the tolerances is set, so that error control chooses the steps.
bool controls_error(const Options&);

struct Scene;  // core/scene/scene.hpp

/// The components of the state that Options::states selects.
std::vector<Index> recorded_components(const Scene&, const Options&);

}  // namespace bromwich
