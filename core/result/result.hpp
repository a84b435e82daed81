#pragma once

#include "../base/types.hpp"
#include "../seam/lcp_count.hpp"
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
  double sweeps = 0;  ///< of `solve`: the functional iteration after its first batch, all parts
};
Seconds operator+(const Seconds&, const Seconds&);

LcpCount& operator+=(LcpCount&, const LcpCount&);

/// What the error of a result is made of; core/solve/error_control.hpp estimates it. All parts are relative: that of a
/// component to max(max_t |c_i|, 1e-3 of the largest component of its kind), see core/accuracy/convergence.hpp.
struct ErrorEstimate {
  double discretisation = std::numeric_limits<double>::quiet_NaN();  ///< of the finest grid, from the grids before it
  double kernel = std::numeric_limits<double>::quiet_NaN();          ///< of the weights; NaN where nothing was compared
  double iteration = 0;                                              ///< left by the last sweep
  double rounding = 0;  ///< carried along with the active sets; 0 where it was not looked at (large and sparse scenes)
  double states = std::numeric_limits<double>::quiet_NaN();  ///< of the recorded x, a component by its largest value
  double order = std::numeric_limits<double>::quiet_NaN();   ///< observed on the last grids; NaN where none was
  double interior =
      0;  ///< defect between the time points; 0 where it was not looked at (core/accuracy/interior_check.hpp)
  double tolerance = 0;      ///< the smallest one given
  bool of_integral = false;  ///< of the mean of y over [0, t] instead of y(t), where y may jump
  std::vector<Index> grids;  ///< steps of all grids, the finest last

  double total() const;  ///< of y: the sum of its parts, a kernel error that is not known left out
};

struct GoalReport;   // core/goal/options.hpp
struct StepDefects;  // core/kernel/step_defects.hpp

/// How an interval of method galerkin is taken (core/galerkin/rules.hpp).
enum class IntervalRule : char { galerkin, radau, euler };

struct Result {
  Status status = Status::unsupported;
  std::string reason;  ///< one line wherever status is not solved

  Vector t;     ///< J+1 times
  RowMatrix y;  ///< (J+1) x n; rows after the last valid time are NaN
  /// J x n, method galerkin: y at the left end of step j, y.row(j+1) at its right; by Radau IIA at a third of the step.
  /// Empty otherwise.
  RowMatrix y_left;
  /// (J+1) x n, the integral of y over [0, t_j] with the quadrature of the steps, impulses that move the state
  /// included; empty where y_left or linear interpolation of the rows of y tells it.
  RowMatrix y_integral;
  /// Method galerkin: the rule of each step (core/galerkin/rules.hpp); empty where all are taken by the method itself.
  std::vector<IntervalRule> interval_rules;
  RowMatrix x;                      ///< (J+1) x components of the state that were asked for
  std::vector<Index> x_components;  ///< which
  RowMatrix trace;                  ///< (J+1) x n, N x where it was asked for; w = trace + M y + g
  /// Whether y alternates for many rows (core/kernel/ringing.hpp), where the backend has looked at it already.
  std::optional<bool> alternates;
  bool continuous = true;  ///< y is linear between its rows; false: it may jump from step to step
  Index rough_steps = 0;  ///< steps in which f or g is not resolved by the grid, or jumps (core/scene/source_steps.hpp)
  bool well_posed = true;  ///< the problems of the steps are known to determine y, as far as that was looked at
  std::optional<double> infeasible_at;
  std::string warning;  ///< one line about a result that may be called solved: uniqueness, conditioning; or empty

  /// max_j ||min(y,w)||_inf / max(1, ||N x + g||_inf) with the kernel of the method; NaN where no solution was
  /// evaluated.
  double residual = std::numeric_limits<double>::quiet_NaN();
  /// ||E0 x(0) + ET x(T) - b||_inf / max(1, ||b||_inf); empty without a boundary condition.
  std::optional<double> boundary_residual;
  /// total() of `errors`, or of x if that is larger. Without Options::tolerance, from method multigrid alone: of y at
  /// the points of the next coarser grid, in the maximum norm. Empty where not estimated.
  std::optional<double> error_estimate;
  /// Method multigrid: what further cycles would change, in the measure of `history`. Empty where not estimated.
  std::optional<double> algebraic_error;
  std::optional<ErrorEstimate> errors;  ///< with Options::tolerance
  /// Deviation of the kernel weights from values they were not made from, relative to the largest; NaN where there are
  /// none to compare with. Where x0 starts the kernel and deviates by more, relative to all parts of N x0 in a mode:
  /// that.
  double kernel_error = std::numeric_limits<double>::quiet_NaN();

  /// Largest growth of perturbations along the solution (core/accuracy/magnification.hpp); NaN where it was not looked
  /// at: sparse dynamics, Kronecker sums and very long or large dense scenes.
  double magnification = std::numeric_limits<double>::quiet_NaN();
  /// What rounding adds up to along the solution; 0 where it was not looked at.
  double rounding = 0;       ///< of the state, relative
  double rounding_of_y = 0;  ///< of y, not relative

  /// How far f and g are, at most, from what is taken for them between points of the grid, relative to the largest
  /// value of a component; 0: resolved, as far as they were looked at.
  double unresolved_sources = 0;
  bool jumps_inside = false;  ///< g jumps and the method takes no step in parts: y has order 1 around those times
  /// Steps that were taken in parts, for states computed afterwards; null where none was.
  std::shared_ptr<const StepDefects> defects;

  std::shared_ptr<const GoalReport> goal;  ///< of method goal: quantity, estimates and energies; null otherwise

  Method method = Method::automatic;  ///< that solved the scene, or was tried last
  std::string backend;
  std::string kernel;                ///< how the kernel was made and applied, in words
  bool starts_with_impulse = false;  ///< x0 violates the constraints: the state jumps at t = 0, row 0 of y is no value
  Index euler_steps = 0;             ///< of Radau IIA, taken by implicit Euler since the state jumps in them
  Index steps = 0, iterations = 0, cycles = 0;
  std::vector<double> history;  ///< max change of y per iteration, or per cycle, relative to max(1, |y|)
  LcpCount lcp;
  Seconds seconds;
  std::size_t bytes = 0;  ///< arrays and plans held by the solve
  /// What core/solve/cost.hpp predicted before the solve, for auto the first of its methods that fits.
  std::size_t bytes_predicted = 0;
};

/// (J+1) x n: the integral of y over [0, t_j], by the rule that the method takes y with. Rows without y are NaN.
RowMatrix integral_of_y(const Result&);

/// The same of a scene with an idle constraint (core/scene/port_hamiltonian.hpp): its y = 0.
Result with_idle_constraint(Result);

/// One more sentence of Result::warning; nothing where it is said already.
void add_warning(Result&, const std::string& sentence);

}  // namespace bromwich
