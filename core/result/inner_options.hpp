#pragma once
// The options of the user, and what the stages of a solve tell each other.

#include "options.hpp"

#include <memory>

namespace bromwich {

struct NaturalUnits;  // core/scene/natural_units.hpp
struct Prepared;      // core/solve/prepared.hpp
class GridFamily;     // core/kernel/shared_dynamics.hpp

/// Made from the user's Options by `solve` and Solver. The defaults are those of a solve on one grid.
struct InnerOptions : Options {
  /// Null: the scene is as its user stated it, and a stage brings it to natural units. Otherwise it is in these, and
  /// what is absolute (measures relative to max(1, |y|), `residual` of method galerkin) is meant in the user's.
  std::shared_ptr<const NaturalUnits> units = {};
  /// What a Solver keeps, or a solve to a tolerance from one grid to the next; null: nothing is kept.
  std::shared_ptr<Prepared> prepared = {};
  /// What all grids of this solve share; null: each method on a grid has its own.
  std::shared_ptr<GridFamily> family = {};
  /// The solve is one of several on finer and finer grids: a result is not confirmed with half the step again.
  bool compares_grids = false;
  /// Sources are sampled inside every step, not inside some of them.
  bool look_inside_every_step = false;
  /// Method shooting: chunks of time, 0: by the threads, as many as the steps allow; and whether their first states are
  /// those of a march of few steps, or all x0. For studies.
  Index chunks = 0;
  bool coarse_start = true;
  /// Steps of small scenes may be evaluated by affine pieces; false: each is a problem of its own. For studies.
  bool by_pieces = true;
  /// Method automatic may end with implicit Euler, of first order, where no method of second order takes a step.
  bool fall_back_to_euler = true;
};

}  // namespace bromwich
