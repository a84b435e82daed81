#pragma once
// Options of a solve.

#include "../base/types.hpp"
#include "method.hpp"

#include <functional>
#include <memory>
#include <vector>

namespace bromwich {

struct GoalOptions;   // core/goal/options.hpp
struct Prepared;      // core/solve/prepared.hpp
struct NaturalUnits;  // core/scene/natural_units.hpp

enum class StateSelection { none, all, list };
enum class ConvolutionChoice { automatic, scan, fft };
enum class RecurrenceChoice { automatic, modal, compressed };

struct Progress {
  Index iteration = 0;  ///< completed sweeps; with `total` > 0, completed time steps
  double change = 0;    ///< of y in the last sweep
  Index total = 0;      ///< steps of a march, 0 for an iteration
};

struct Options {
  Method method = Method::automatic;
  Index steps = 0;  ///< 0 = the scene's default; with a tolerance: of the first grid
  /// The grid is refined until the estimated error of component i is at most
  /// tolerance max(max_t |c_i|, 1e-3 of the largest component of the same kind), for y and the recorded states
  /// (core/solve/error_control.hpp). 0 = one grid.
  double tolerance = 0;
  double tolerance_x = 0;              ///< for the recorded states instead of `tolerance`; alone: y is not controlled
  double tolerance_y = 0;              ///< for y instead of `tolerance`; alone: the states are not controlled
  double absolute_tolerance = 0;       ///< in the units of the scene; added to the relative tolerances
  bool control_states = true;          ///< the tolerance applies to the recorded states too
  Index max_steps = Index(1) << 20;    ///< of the finest grid, with a tolerance
  double max_seconds = 0;              ///< with a tolerance, no further grid after this time; 0 = no limit
  double iteration_tolerance = 1e-12;  ///< max change of y relative to max(1, |y|)
  /// Multigrid also stops when its estimated algebraic error is below this part of the estimated discretisation error;
  /// 0 = only iteration_tolerance decides.
  double algebraic_share = 0;
  Index max_iterations = 2000;  ///< convergence takes tens to hundreds; divergence is detected earlier
  StateSelection states = StateSelection::none;
  std::vector<Index> components = {};  ///< with StateSelection::list
  /// The caller compares several grids: results are not confirmed with half the step.
  bool compares_grids = false;
  /// Method automatic may use implicit Euler, of first order, if no method of second order can solve the steps.
  bool fall_back_to_euler = true;
  bool trace = false;  ///< record N x
  /// As in error control, sources are sampled inside every step, not only inside some.
  bool look_inside_every_step = false;
  /// Method galerkin: solve again with nodes at the switches of the active sets (core/galerkin/location.hpp).
  bool event_location = false;
  ConvolutionChoice convolution = ConvolutionChoice::automatic;
  RecurrenceChoice recurrence = RecurrenceChoice::automatic;  ///< exponentials in marching: all modes, or compressed
  Index literal_nodes = 25;                                   ///< P of contour_literal (the paper's choice)
  /// (J+1) x n: first iterate of y; null: the iteration starts from the constant state x0. Not used for M of class Z,
  /// whose least solution is reached from x0.
  const RowMatrix* first_iterate = nullptr;
  std::shared_ptr<const GoalOptions> goal = {};  ///< of method goal; null: its defaults
  /// Null: `solve` scales the scene to natural units. Otherwise the scene is in these units, and absolute measures
  /// (relative to max(1, |y|), `residual` of method galerkin) refer to them; NaturalUnits{} leaves a scene unscaled.
  std::shared_ptr<const NaturalUnits> units = {};
  /// Set by a Solver (core/solve/solver.hpp); null: nothing is kept after the solve.
  std::shared_ptr<Prepared> prepared = {};
  double memory_limit = 0;  ///< bytes; a solve with a larger predicted need throws Error. 0 = no limit
  std::function<void(const Progress&)> progress = {};  ///< called during the solve
  std::function<bool()> interrupted = {};              ///< polled once per iteration; true ends the solve
};

/// Whether any of the tolerances is set, so that error control chooses the steps.
bool controls_error(const Options&);

struct Scene;  // core/scene/scene.hpp

/// The components of the state that Options::states selects.
std::vector<Index> recorded_components(const Scene&, const Options&);

}  // namespace bromwich
