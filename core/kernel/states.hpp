#pragma once
// The state x of a solution y. Methods do not need it; it is computed on request.

#include "../dynamics/sparse_shifts.hpp"
#include "discrete_problem.hpp"
#include "kernel.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace bromwich {

/// All components at chosen time points: m x rows.size(). With u = y (+ phi),
///
///     x_j = e^{A t_j} x0 + Σ_windows Σ_p (z_p I - A)^{-1} B [ Σ_d c_p F_d(z_p) u_{j-d} ],
///
/// which takes the shifted solves of a few contours per time point, independent of j (Kronecker sum). Dense and sparse
/// dynamics are stepped; those of callbacks are not supported.
Matrix states_at_rows(const DiscreteProblem&, const RowMatrix& y, const std::vector<Index>& rows,
                      const StepDefects* defects = nullptr);

/// Factors of one step of length h at nodes z_p: of e^{hA}, and of both ends of a linear input.
struct StepFactors {
  ComplexVector decay, left, right;
};
/// On the contour of the first lags.
StepFactors step_factors(const LagWindow&, double h);
/// With the poles of the best rational approximation of e^x for x <= 0, of degree 14: for symmetric dynamics that
/// decay.
StepFactors rational_step_factors(double h, ComplexVector& nodes);

/// The state of sparse dynamics, one time point after the other. With S(z) = (zE - A)^{-1},
///
///     x_j = Re Σ_p S(z_p) [d_p E x_{j-1} + l_p b_{j-1} + r_p b_j],   b_j = B y_j + f_j,
///
/// at 7 poles where A and E are symmetric and the state decays, else at the 25 nodes of a contour. The factors of
/// z_p E - A are made once and kept.
class SteppedStates {
 public:
  /// Null where A is not a known sparse matrix, no contour holds its spectrum, or elimination needs pivots.
  static std::unique_ptr<const SteppedStates> make(const DiscreteProblem&);

  /// Calls visit(j, x_j) for 0 <= j <= last.
  void each(const RowMatrix& y, Index last, const std::function<void(Index j, const Vector& x)>& visit) const;

 private:
  explicit SteppedStates(const DiscreteProblem& p, const SparseDynamics& d) : p_(p), shifts_(d) {}
  bool try_poles(const SparseDynamics&);
  bool try_contour(const ContourParameters&, double shift);
  Vector advance(const Vector& x, const Vector& before, const Vector& now) const;

  const DiscreteProblem& p_;
  SparseShifts shifts_;
  std::shared_ptr<const SparseShifts::Factors> solves_;
  StepFactors factors_;
};

/// How an operator of sparse dynamics finds the components that a problem records: few are rows of its kernel, with
/// weights of their own; more are taken from stepped states, whose work does not depend on their number.
class RecordedStates {
 public:
  /// A component in the kernel costs about a hundredth of all steps.
  static constexpr Index most_in_kernel = 128;

  explicit RecordedStates(const DiscreteProblem& p) : p_(p) {}

  /// The components that the kernel has: all or none.
  const std::vector<Index>& in_kernel();
  /// All components from y, (J+1) x c; empty if the kernel has them.
  std::optional<RowMatrix> stepped(const RowMatrix& y);

 private:
  const DiscreteProblem& p_;
  std::optional<std::unique_ptr<const SteppedStates>> steps_;  ///< empty: not yet known; null: in the kernel
};

}  // namespace bromwich
