#pragma once
// The result of a solve: the solution, what is known of its error, and how it was found.

#include "memory.hpp"
#include "options.hpp"
#include "types.hpp"

#include <cstddef>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// Counters of a batch of complementarity problems.
struct LcpCount {
  long solved = 0;     ///< problems solved
  long newton = 0;     ///< semismooth Newton sweeps over single problems
  long fallbacks = 0;  ///< problems that needed pivoting or a restart from the empty active set
  long unsolved = 0;   ///< problems left with a residual above rounding level

  LcpCount& operator+=(const LcpCount& other) {
    solved += other.solved;
    newton += other.newton;
    fallbacks += other.fallbacks;
    unsolved += other.unsolved;
    return *this;
  }
};

enum class Status { solved, tolerance_not_met, infeasible, unsupported, nonfinite, interrupted };

/// "solved", "tolerance_not_met", ...
const char* to_string(Status);

/// Wall-clock seconds. `setup` ends before the first complementarity problem or step; `solve` is the rest.
struct Seconds {
  double total = 0, setup = 0, solve = 0;
  double lcp = 0, convolution = 0, transform = 0, other = 0;  ///< parts of `solve`
  double sweeps = 0;         ///< of `solve`: the functional iteration after its first batch, all parts
  double certification = 0;  ///< of `other`: checks of the result, with the solves that confirm it

  /// What was done around a solve: before it, as set-up, and behind it, as `other`.
  void add_around(double before, double behind);
};
Seconds operator+(const Seconds&, const Seconds&);

/// The parts of the error of a result, with a tolerance. All are relative, for a component to
/// max(max_t |c_i|, 1e-3 of the largest component of its kind).
struct ErrorEstimate {
  double discretisation = std::numeric_limits<double>::quiet_NaN();  ///< of the finest grid, from the coarser grids
  double kernel = std::numeric_limits<double>::quiet_NaN();          ///< of the weights; NaN if not compared
  double iteration = 0;                                              ///< after the last sweep
  double rounding = 0;  ///< propagated with the active sets; 0 if not computed (large and sparse scenes)
  double states =
      std::numeric_limits<double>::quiet_NaN();  ///< of the recorded x, each component relative to its largest value
  double order = std::numeric_limits<double>::quiet_NaN();  ///< observed on the last grids; NaN if none
  double interior = 0;                                      ///< defect between the time points; 0 if not computed
  double tolerance = 0;                                     ///< the smallest one given
  bool of_integral = false;       ///< the error is that of the mean of y over [0, t], since y may jump
  std::vector<Index> grids;       ///< steps of all grids, the finest last
  std::vector<double> estimates;  ///< of each grid: error_estimate as it was then; NaN where there was none

  double total() const;  ///< of y: the sum of its parts, without an unknown kernel error
};

struct GoalReport;
struct LocatedSolution;
struct Scene;
struct StepDefects;

/// Discretisation of an interval of method galerkin.
enum class IntervalRule : char { galerkin, radau, euler };

/// What the exact flow of y and a solution with located switches say about a result, in numbers without units.
struct Certificate {
  /// Backward error d(t) = |min(w, D y)| / s of y with the state of the exact flow: the result is exact for a scene
  /// whose g is off by d s, s_i = max_t (|M||y| + |N||x| + |g|)_i.
  double mean_defect = 0, largest_defect = 0;
  double defect_at = 0;   ///< the time of the largest over T
  Index defect_row = -1;  ///< its row of w
  /// Differences from the located solution, the largest over the rows, relative to the size of the
  /// component. `error_of_mean` is that of the mean of y over [0, t]. Where y may be
  /// one of several, `error_of_y` is no more than that of B y and M y.
  double error_of_x = 0, error_of_y = 0, error_of_mean = 0;
  double typical_error_of_x = 0;  ///< the same beside values so far, exceeded at one row of twenty
  bool impulses = false;          ///< the state jumps: y is known by its mean
};

struct Impact {
  double t = 0;
  Vector p;     ///< n: impulses
  Vector jump;  ///< m: of the state, B p
};

/// y and x over time.
struct Solution {
  Vector t;     ///< J+1 times
  RowMatrix y;  ///< (J+1) x n; rows after the last valid time are NaN
  /// J x n, method galerkin: y at the left end of step j (y.row(j+1) is its right end); where interval_rules has Radau
  /// IIA, at a third of the step. Empty for other methods.
  RowMatrix y_left;
  /// (J+1) x n, the integral of y over [0, t_j] with the quadrature of the steps, including impulses on the state.
  /// Empty if it follows from y_left or from linear interpolation of the rows of y.
  RowMatrix y_integral;
  /// Method galerkin: the rule of each step; empty if all use the Galerkin discretisation.
  std::vector<IntervalRule> interval_rules;
  RowMatrix x;                      ///< (J+1) x requested components of the state
  std::vector<Index> x_components;  ///< their indices
  RowMatrix trace;                  ///< (J+1) x n, N x if requested; w = trace + M y + g
  /// (J+1) x memories: the number of the mode of each, on the side that y is on; -1 where y is NaN. Empty: no memories.
  RowMatrix modes;
  std::vector<ModeChange> mode_changes;  ///< in order of time
  Vector start;                          ///< m, method shooting with a boundary condition: x(0)
  /// Methods that locate switches: polynomials between them, which the rows are values of; otherwise null.
  std::shared_ptr<const LocatedSolution> located;
  /// Steps that are divided at impacts: these, in order of time; otherwise null.
  std::shared_ptr<const std::vector<Impact>> impacts;
  bool continuous = true;            ///< y is linear between its rows; false: it may jump from step to step
  bool starts_with_impulse = false;  ///< x0 violates the constraints: the state jumps at t = 0, y_0 is an impulse
  /// Steps that were divided into parts, for states computed afterwards; null if none.
  std::shared_ptr<const StepDefects> defects;
};

/// How far a solution is from the exact one, and whether there are others.
struct Accuracy {
  /// max_j ||min(y,w)||_inf / max(1, ||N x + g||_inf) with the kernel of the method; NaN if no solution was evaluated.
  double residual = std::numeric_limits<double>::quiet_NaN();
  /// ||E0 x(0) + ET x(T) - b||_inf / max(1, ||b||_inf); empty without a boundary condition.
  std::optional<double> boundary_residual;
  /// total() of `errors`, or the error of x if that is larger. Without Options::tolerance only method multigrid sets
  /// it: the error of y at the points of the next coarser grid, in the maximum norm. Empty if not estimated.
  std::optional<double> error_estimate;
  /// Method multigrid: the estimated change of y by further cycles, in the norm of `history`. Empty if not estimated.
  std::optional<double> algebraic_error;
  std::optional<ErrorEstimate> errors;  ///< with Options::tolerance
  /// Of given steps of small dense scenes with initial values; empty without Options::confirm and for method events.
  std::optional<Certificate> certificate;
  /// Difference of the kernel weights from independently computed values, relative to the largest; NaN if there are
  /// none. If the response to x0 has a larger difference, relative to all parts of N x0 in a mode: that difference.
  double kernel_error = std::numeric_limits<double>::quiet_NaN();
  /// Largest growth of perturbations along the solution; NaN if not computed: sparse dynamics, Kronecker sums and very
  /// long or large dense scenes.
  double magnification = std::numeric_limits<double>::quiet_NaN();
  double rounding = 0;       ///< accumulated rounding errors of the state, relative; 0 if not computed
  double rounding_of_y = 0;  ///< the same of y, not relative
  /// Method shooting, periodic conditions: the eigenvalues of the derivative of x(T) by x(0), the largest first. All
  /// are less than 1 in size where perturbations of the periodic state decay.
  std::vector<Complex> multipliers;
  /// Largest difference of f and g from their approximation between grid points, relative to the largest value of a
  /// component; 0: resolved at all sampled times.
  double unresolved_sources = 0;
  Index rough_steps = 0;           ///< steps in which f or g is not resolved by the grid, or jumps
  bool jumps_inside = false;       ///< g jumps and the method does not divide steps: y has order 1 around those times
  bool well_posed = true;          ///< false: a tested problem of a step is not known to determine y
  std::optional<bool> alternates;  ///< y alternates for many rows; empty: not tested by the backend
  std::optional<double> infeasible_at;  ///< the first time without a solution
  std::string warning;  ///< one line about uniqueness or conditioning, also if status is solved; or empty
};

/// What a solve did, and what it took.
struct Work {
  Index steps = 0, iterations = 0, cycles = 0;
  Index euler_steps = 0;  ///< steps of a Radau IIA march that use implicit Euler since the state jumps
  /// Of method multigrid: applications of K and passes over all complementarity problems (sweeps of projected
  /// relaxation, or batches that solve them) on all grids, the nested start included, in units of the finest grid.
  double convolutions = 0, passes = 0;
  std::vector<double> history;  ///< max change of y per iteration, or per cycle, relative to max(1, |y|)
  LcpCount lcp;
  Seconds seconds;
  std::size_t bytes = 0;  ///< arrays and plans held by the solve
  /// Memory that was predicted before the solve; for auto, of its first method that fits.
  std::size_t bytes_predicted = 0;
};

struct Result : Solution, Accuracy, Work {
  Status status = Status::unsupported;
  std::string reason;                 ///< one line if status is not solved
  Method method = Method::automatic;  ///< the method that solved the scene, or the last one tried
  std::string backend;
  std::string form = {};                   ///< of multigrid and dual: "primal" (cycles in y) or "dual" (cycles in w)
  std::string kernel;                      ///< description of how the kernel was made and applied
  std::shared_ptr<const GoalReport> goal;  ///< of method goal: quantity, estimates and energies; null otherwise
};

/// (J+1) x n: the integral of y over [0, t_j], by the quadrature of the method. Rows without y are NaN.
RowMatrix integral_of_y(const Result&);

/// w = N x + M y + g(t) at the times of a result, one row each; empty if N x was not recorded (Options::trace). g is
/// that of the scene now. Where it jumps at a row: its value at t, but of methods that locate switches the limit on the
/// side that y is on.
RowMatrix slack(const Scene&, const Result&);
/// The rows first, ..., first + count - 1.
RowMatrix slack(const Scene&, const Result&, Index first, Index count);

// The times at which constraints become active and inactive, more accurately than the time grid.
//
// Component i is active at t_j if y_j > 0. If this changes in the step from t_j to t_{j+1}, y of the active side is
// extrapolated linearly to zero, from the two nearest rows:
//
//     off:  t* = t_j + h y_j / (y_{j-1} - y_j),          on:  t* = t_{j+1} - h y_{j+1} / (y_{j+2} - y_{j+1}).
//
// For discontinuous y (Result::y_left) the two values are those of the adjacent interval that is active throughout. The
// second difference of three rows estimates the error: O(h^2) if y leaves 0 with a slope. If y jumps, or is active for
// one row only, or the root is not in the step, t* is the middle of the step.

struct Switch {
  double t = 0;
  Index component = 0;  ///< of y
  bool on = false;      ///< y becomes positive
  double error = 0;     ///< estimated, of t: h/2 if only the step is known
};

/// The switches of all components of a result, in order of time, up to the first invalid row. `negligible`: y below
/// this part of its largest value counts as 0. Where they were located, these, with what two integrations differ by.
std::vector<Switch> switches(const Solution&, double negligible = 1e-12);

/// What a relay does at a switch: lambda is -1, 1, or 0 for a value between them (sliding).
struct RelaySwitch {
  double t = 0;
  Index relay = 0;
  int from = 0, to = 0;
  double error = 0;  ///< estimated, of t
};

/// The switches of a result with y = (s, y+) of 2k components (relay_scene) as those of its k relays: lambda is -1
/// where y+ > 0, otherwise 0 where s > 0, otherwise 1. Switches of s and y+ within one step (not of method events), or
/// within their errors, are one.
std::vector<RelaySwitch> relay_switches(const Result&, const std::vector<Switch>&, Index relays);

/// Counts of computed data; data found here do not count.
struct PreparationCounts {
  Index exponentials = 0;     ///< e^{hA} with its phi-functions from the beginning
  Index doublings = 0;        ///< the same from half the step
  Index factorizations = 0;   ///< of I - hA
  Index spectra = 0;          ///< of A
  Index fits = 0;             ///< of a kernel by exponentials
  Index initial_fits = 0;     ///< of the response to x0
  Index shifted_solves = 0;   ///< nodes at which N (zE - A)^{-1} B was computed, for lag weights of sparse dynamics
  Index classifications = 0;  ///< of M
};

}  // namespace bromwich
