#pragma once
// Options of a solve.

#include "types.hpp"

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace bromwich {

enum class Method {
  automatic,
  multigrid,        ///< cycles over nested time grids, in y or in w
  dual,             ///< the same in w, for M small, singular or zero (docs/dual.md)
  contour,          ///< functional iteration, all time points at once, shared contours
  contour_literal,  ///< (2.17) of the Laplace-inversion paper, one contour per time point
  march,            ///< time stepping: exponential with piecewise-linear y, or Radau IIA
  euler,            ///< implicit Euler (1.3)-(1.4)
  events,           ///< event-driven: collocation of high order between located switches
  shooting,         ///< Newton's method: on x(0) for boundary values, over chunks of time for initial values
  galerkin,         ///< exponential Galerkin, all intervals at once: boundary values and mixed problems
  goal,             ///< a time grid adapted to a quantity of interest
};

/// "auto", "contour", ...
const char* to_string(Method);
/// Inverse of to_string; throws Error("method", ...) for an unknown name.
Method method_from_string(const std::string&);

enum class LogLevel {
  debug,    ///< how a decision is carried out
  info,     ///< decisions: methods, grids, solves for confirmation
  warning,  ///< the text of Result::warning
};

/// A message about a decision of the solve.
struct LogEntry {
  LogLevel level = LogLevel::info;
  std::string text;  ///< one line
};

/// Called from the thread that called `solve`; if it is empty, no text is made.
using Log = std::function<void(const LogEntry&)>;

enum class ConvolutionChoice { automatic, scan, fft };
enum class RecurrenceChoice { automatic, modal, compressed };

/// Options for studies of the methods. The defaults suit all other uses.
struct Tuning {
  /// How contour and multigrid evaluate K * y: recurrences in time (`scan`), or FFTs of the lag weights. Where only one
  /// of them applies it is taken. Default: chosen by the form of the dynamics and by predicted operations.
  ConvolutionChoice convolution = ConvolutionChoice::automatic;
  /// Exponentials that march carries in a Kronecker sum: one for each eigenvalue (`modal`), or the fewer ones of the
  /// compressed kernel. Default: compressed, where there are many eigenvalues and it halves their number at least.
  RecurrenceChoice recurrence = RecurrenceChoice::automatic;
  /// Radau IIA takes steps in which the state jumps by implicit Euler; false: by both stages, for comparisons.
  bool substitutes_euler = true;
  /// Cycles in w take implicit Euler; false: the two stages of Radau IIA, as march does, where the problem allows it.
  bool dual_by_euler = false;
  /// P of contour-literal, whose contours have P + 1 nodes: 2 to 400. Default: that of the paper.
  Index literal_nodes = 25;
  /// Multigrid may stop earlier than Options::iteration_tolerance says, where what the cycles would still change is
  /// below this part of the discretisation error, both estimated. From 0 to below 1; 0 (the default): the iteration
  /// tolerance alone decides. Error control sets it by itself.
  double algebraic_share = 0;
  /// y where the functional iteration starts: (J+1) x n, in the units of the scene. Null (the default): it starts from
  /// the constant x0, as it always does for M of class Z, whose least solution is reached from there. Has to live as
  /// long as the solve; a Solver copies it.
  const RowMatrix* first_iterate = nullptr;
};

struct GoalOptions;

enum class StateSelection { none, all, list };

struct Progress {
  Index iteration = 0;  ///< completed sweeps; with `total` > 0, completed time steps
  double change = 0;    ///< of y in the last sweep
  Index total = 0;      ///< steps of a march, 0 for an iteration
};

struct Options {
  Method method = Method::automatic;
  /// Time steps J, with a tolerance those of the first grid. 0: those of the scene, or chosen; where neither steps nor
  /// a tolerance are given, the tolerance of the scene, or 1e-3 where it states no steps either.
  Index steps = 0;

  /// Error to reach by refining the grid, 0 = one grid: that of component i is at most
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

  /// Method galerkin: solved again with nodes at the switches of the active sets.
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

}  // namespace bromwich
