#pragma once
// State maps of dynamics known by shifted solves (derivatives/state_maps.hpp), with S(z) = (zE - A)^{-1}:
//
//     N e^{At} x0 = Re Σ_p c_p e^{z_p t} N S(z_p) E x0      for the time points of a window of contour nodes,
//     x_j = Re Σ_p S(z_p) [d_p E x_{j-1} + B (l_p u_{j-1} + r_p u_j)]      on the contour of one step,
//
// where d, l and r are the factors of e^{hA}, L and R. The transposed maps have the same nodes and S(z)^T, so that they
// are transposed to rounding, not to the error of the contours alone. Where A is known, both take the same factors of
// z_p E - A, made once and kept.

#include "../core/dynamics/sparse_shifts.hpp"
#include "../core/kernel/discrete_problem.hpp"
#include "../core/kernel/kernel.hpp"
#include "state_maps.hpp"

#include <optional>
#include <vector>

namespace bromwich {

class ContourStates final : public StateMaps {
 public:
  /// On the backend of the problem. Throws Error if no contour holds the spectrum. Not for several threads at once.
  explicit ContourStates(const DiscreteProblem&);

  RowMatrix seen(const Vector& x0) const override;
  Vector seen_transposed(const RowMatrix& rho) const override;
  RowMatrix states(const Vector& x0, const RowMatrix& u) const override;
  std::pair<RowMatrix, Vector> states_transposed(const RowMatrix& of_x) const override;

 private:
  struct Step;
  bool take_windows(const ContourParameters&, double shift);
  ComplexMatrix seen_at(const Vector& right, const ComplexVector& nodes) const;
  ComplexMatrix seen_in(const Vector& right, std::size_t window) const;
  ComplexMatrix solve_transposed(const ComplexMatrix& right, std::size_t window) const;
  std::shared_ptr<const SparseShifts::Factors> factors_of(std::size_t window) const;

  Dynamics d_;
  std::optional<Dynamics> transposed_;  ///< A^T, E^T, B^T as outputs and N^T as inputs, where they are known
  Backend& backend_;
  const HostThreads& threads_;
  SparseMatrix B_, N_;
  Index J_ = 0;
  double h_ = 0;
  std::vector<LagWindow> windows_;
  std::unique_ptr<SparseShifts> shifts_;  ///< where A is known
  /// Factors at the nodes of the windows, as many as `most_kept_bytes` hold. Null: not made, or not kept.
  mutable std::vector<std::shared_ptr<const SparseShifts::Factors>> kept_;
};

}  // namespace bromwich
