#pragma once
// What a user may ask of a solve.

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
  Index iteration = 0;  ///< sweeps done, or time steps where `total` says how many there are
  double change = 0;    ///< of the last sweep
  Index total = 0;      ///< steps of a march, 0 for an iteration
};

struct Options {
  Method method = Method::automatic;
  Index steps = 0;  ///< 0 = the scene's default; with a tolerance the first grid
  /// Error to reach by refining the grid (core/solve/error_control.hpp), 0 = one grid: that of component i is at most
  /// tolerance max(max_t |c_i|, 1e-3 of the largest component of the same kind). For y, and for the recorded states.
  double tolerance = 0;
  double tolerance_x = 0;              ///< for the recorded states in place of `tolerance`; alone: y is not controlled
  double tolerance_y = 0;              ///< for y in place of `tolerance`; alone: the states are not controlled
  double absolute_tolerance = 0;       ///< in the units of the scene; added to what the others allow
  bool control_states = true;          ///< the tolerance is for the recorded states too
  Index max_steps = Index(1) << 20;    ///< of the finest grid that a tolerance may lead to
  double max_seconds = 0;              ///< after which a tolerance leads to no further grid; 0 = no limit
  double iteration_tolerance = 1e-12;  ///< max change of y relative to max(1, |y|)
  /// Multigrid may stop earlier, where what the cycles would still change is below this part of the discretisation
  /// error, both estimated; 0 = iteration_tolerance alone decides.
  double algebraic_share = 0;
  Index max_iterations = 2000;  ///< converging scenes need tens to hundreds; others stop earlier by themselves
  StateSelection states = StateSelection::none;
  std::vector<Index> components = {};  ///< with StateSelection::list
  /// The caller solves on several grids and compares: a result is not confirmed with half the step again.
  bool compares_grids = false;
  /// Method automatic may end with implicit Euler, of first order, where no method of second order takes a step.
  bool fall_back_to_euler = true;
  bool trace = false;  ///< record N x
  /// Sources are looked at inside every step, and not inside some: error control does.
  bool look_inside_every_step = false;
  /// Method galerkin: solved again with nodes at the switches of the active sets (core/galerkin/location.hpp).
  bool event_location = false;
  ConvolutionChoice convolution = ConvolutionChoice::automatic;
  RecurrenceChoice recurrence = RecurrenceChoice::automatic;  ///< exponentials in marching: all modes, or compressed
  Index literal_nodes = 25;                                   ///< P of contour_literal (the paper's choice)
  /// (J+1) x n, where the iteration starts instead of from the constant x0; not for M of class Z, whose least solution
  /// is reached from there.
  const RowMatrix* first_iterate = nullptr;
  std::shared_ptr<const GoalOptions> goal = {};  ///< of method goal; null: its defaults
  /// Null: `solve` brings the scene to natural units. Otherwise it is in these already, and what is absolute (measures
  /// relative to max(1, |y|), `residual` of method galerkin) is meant in them; NaturalUnits{} leaves a scene as it is.
  std::shared_ptr<const NaturalUnits> units = {};
  /// Of a Solver (core/solve/solver.hpp); null: nothing is kept.
  std::shared_ptr<Prepared> prepared = {};
  double memory_limit = 0;  ///< bytes; a solve that is predicted to need more is refused. 0 = no limit
  std::function<void(const Progress&)> progress = {};
  std::function<bool()> interrupted = {};  ///< polled once per iteration
};

/// Whether any of the tolerances is set, so that steps are chosen.
bool controls_error(const Options&);

struct Scene;  // core/scene/scene.hpp

/// The components of the state that Options::states asks for.
std::vector<Index> recorded_components(const Scene&, const Options&);

}  // namespace bromwich
