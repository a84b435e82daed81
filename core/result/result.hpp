#pragma once

#include "../base/types.hpp"
#include "../lcp/count.hpp"
#include "certificate.hpp"
#include "method.hpp"

#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

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

/// The parts of the error of a result, estimated by core/solve/error_control.hpp. All are relative, for a component to
/// max(max_t |c_i|, 1e-3 of the largest component of its kind); see core/accuracy/convergence.hpp.
struct ErrorEstimate {
  double discretisation = std::numeric_limits<double>::quiet_NaN();  ///< of the finest grid, from the coarser grids
  double kernel = std::numeric_limits<double>::quiet_NaN();          ///< of the weights; NaN if not compared
  double iteration = 0;                                              ///< after the last sweep
  double rounding = 0;  ///< propagated with the active sets; 0 if not computed (large and sparse scenes)
  double states =
      std::numeric_limits<double>::quiet_NaN();  ///< of the recorded x, each component relative to its largest value
  double order = std::numeric_limits<double>::quiet_NaN();  ///< observed on the last grids; NaN if none
  double interior = 0;       ///< defect between the time points; 0 if not computed (core/accuracy/interior_check.hpp)
  double tolerance = 0;      ///< the smallest one given
  bool of_integral = false;  ///< the error is that of the mean of y over [0, t], since y may jump
  std::vector<Index> grids;  ///< steps of all grids, the finest last
  std::vector<double> estimates;  ///< of each grid: error_estimate as it was then; NaN where there was none

  double total() const;  ///< of y: the sum of its parts, without an unknown kernel error
};

struct GoalReport;   // core/goal/options.hpp
struct StepDefects;  // core/kernel/step_defects.hpp

/// Discretisation of an interval of method galerkin (core/galerkin/rules.hpp).
enum class IntervalRule : char { galerkin, radau, euler };

struct Result {
  Status status = Status::unsupported;
  std::string reason;  ///< one line if status is not solved

  Vector t;     ///< J+1 times
  RowMatrix y;  ///< (J+1) x n; rows after the last valid time are NaN
  /// J x n, method galerkin: y at the left end of step j (y.row(j+1) is its right end); for Radau IIA at a third of the
  /// step. Empty for other methods.
  RowMatrix y_left;
  /// (J+1) x n, the integral of y over [0, t_j] with the quadrature of the steps, including impulses on the state.
  /// Empty if it follows from y_left or from linear interpolation of the rows of y.
  RowMatrix y_integral;
  /// Method galerkin: the rule of each step (core/galerkin/rules.hpp); empty if all use the Galerkin discretisation.
  std::vector<IntervalRule> interval_rules;
  RowMatrix x;                      ///< (J+1) x requested components of the state
  std::vector<Index> x_components;  ///< their indices
  RowMatrix trace;                  ///< (J+1) x n, N x if requested; w = trace + M y + g
  /// Whether y alternates for many rows (core/kernel/ringing.hpp), if the backend has tested it already.
  std::optional<bool> alternates;
  bool continuous = true;  ///< y is linear between its rows; false: it may jump from step to step
  Index rough_steps = 0;  ///< steps in which f or g is not resolved by the grid, or jumps (core/scene/source_steps.hpp)
  bool well_posed = true;               ///< false: a tested problem of a step is not known to determine y
  std::optional<double> infeasible_at;  ///< the first time without a solution
  std::string warning;  ///< one line about uniqueness or conditioning, also if status is solved; or empty

  /// max_j ||min(y,w)||_inf / max(1, ||N x + g||_inf) with the kernel of the method; NaN if no solution was evaluated.
  double residual = std::numeric_limits<double>::quiet_NaN();
  /// ||E0 x(0) + ET x(T) - b||_inf / max(1, ||b||_inf); empty without a boundary condition.
  std::optional<double> boundary_residual;
  /// Method shooting, periodic conditions: the eigenvalues of the derivative of x(T) by x(0), the largest first. All
  /// are less than 1 in size where perturbations of the periodic state decay.
  std::vector<Complex> multipliers;
  Vector start;  ///< m, method shooting: x(0)
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

  /// Largest growth of perturbations along the solution (core/accuracy/magnification.hpp); NaN if not computed: sparse
  /// dynamics, Kronecker sums and very long or large dense scenes.
  double magnification = std::numeric_limits<double>::quiet_NaN();
  /// Accumulated rounding errors along the solution; 0 if not computed.
  double rounding = 0;       ///< of the state, relative
  double rounding_of_y = 0;  ///< of y, not relative

  /// Largest difference of f and g from their approximation between grid points, relative to the largest value of a
  /// component; 0: resolved at all sampled times.
  double unresolved_sources = 0;
  bool jumps_inside = false;  ///< g jumps and the method does not divide steps: y has order 1 around those times
  /// Steps that were divided into parts, for states computed afterwards; null if none.
  std::shared_ptr<const StepDefects> defects;

  std::shared_ptr<const GoalReport> goal;  ///< of method goal: quantity, estimates and energies; null otherwise

  Method method = Method::automatic;  ///< the method that solved the scene, or the last one tried
  std::string backend;
  std::string form = {};             ///< of multigrid and dual: "primal" (cycles in y) or "dual" (cycles in w)
  std::string kernel;                ///< description of how the kernel was made and applied
  bool starts_with_impulse = false;  ///< x0 violates the constraints: the state jumps at t = 0, y_0 is an impulse
  Index euler_steps = 0;             ///< steps of a Radau IIA march that use implicit Euler since the state jumps
  Index steps = 0, iterations = 0, cycles = 0;
  /// Of method multigrid: applications of K and passes over all complementarity problems (sweeps of projected
  /// relaxation, or batches that solve them) on all grids, the nested start included, in units of the finest grid.
  double convolutions = 0, passes = 0;
  std::vector<double> history;  ///< max change of y per iteration, or per cycle, relative to max(1, |y|)
  LcpCount lcp;
  Seconds seconds;
  std::size_t bytes = 0;  ///< arrays and plans held by the solve
  /// Memory that core/solve/cost.hpp predicted before the solve; for auto, of its first method that fits.
  std::size_t bytes_predicted = 0;
};

/// The result is one of implicit Euler: of that method, or of cycles in w without stages.
inline bool by_euler(Method method, const Result& result) {
  return method == Method::euler || (result.form == "dual" && result.continuous);
}
inline bool by_euler(const Result& result) { return by_euler(result.method, result); }

/// (J+1) x n: the integral of y over [0, t_j], by the quadrature of the method. Rows without y are NaN.
RowMatrix integral_of_y(const Result&);

/// The same for a scene with an idle constraint (core/scene/port_hamiltonian.hpp), with y = 0.
Result with_idle_constraint(Result);

/// Appends a sentence to Result::warning unless it is already there.
void add_warning(Result&, const std::string& sentence);

}  // namespace bromwich
