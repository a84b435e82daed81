#pragma once
// Linear two-point boundary problems in steps,
//
//     x_k = P_k x_{k-1} + p_k,  k = 1..N,     E0 x_0 + ET x_N = b,
//
// by orthogonal elimination of the inner states. A segment from i to j is summed up as V x_i + U x_j = r; two of them
// share a state, which a QR factorization of [U_1; V_2] separates from the rest (S. J. Wright, SIAM J. Sci. Stat.
// Comput. 13, 1992). Nothing is multiplied up: modes that grow by e^{1000} and modes that decay by it are both held
// where the boundary condition holds them, and what is not determined shows in the condition of the last 2m x 2m
// system.

#include "scene.hpp"

#include <vector>

namespace bromwich {

/// V x_i + U x_j = r.
struct Segment {
  Matrix V, U;  ///< m x m
  Vector r;     ///< m
};

/// One step.
Segment step_segment(const Matrix& P, const Vector& p);

/// x = a + L x_i + R x_j, the state between two segments.
struct InnerState {
  Matrix L, R;  ///< m x m
  Vector a;     ///< m
};

/// `first` and `second` as one segment; `inner`, where given, receives the state they share.
Segment joined(const Segment& first, const Segment& second, InnerState* inner = nullptr);

/// N equal steps x_k = P x_{k-1} + p in O(log N) operations.
Segment repeated(const Matrix& P, const Vector& p, Index N);

/// x_0 and x_N from a segment over all steps and the boundary condition.
struct EndStates {
  Vector first, last;
  double reciprocal_condition = 0;  ///< of the 2m x 2m system, its rows and columns made comparable; 0 where singular
};
EndStates solve_ends(const Segment&, const BoundaryCondition&);

/// All states, (N+1) x m; P has N pointers, p is N x m. Empty (no rows) where the boundary condition does not determine
/// them to `least_condition`. Forward, x_k = Phi_k x_0 + phi_k, where rounding carried along the steps provably stays
/// below 1e-12 + 8 eps N of the states; with many states x_0 by a Krylov method, where that ends; otherwise by
/// segments.
RowMatrix solve_two_point(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition&,
                          double least_condition);

/// (E0 + ET P_N ... P_1) x_0 = b - ET phi_N by GMRES: a product with the matrix is one pass over the steps, O(N m^2),
/// and dissipative steps leave few directions that come around. Empty where 100 products are not enough or what comes
/// out does not satisfy the boundary condition to 1e-11.
RowMatrix solve_two_point_krylov(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition&);
inline constexpr Index fewest_krylov_states = 64;

/// The other two by themselves; forward: empty where rounding grows too much.
RowMatrix solve_two_point_forward(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition&,
                                  double least_condition);
RowMatrix solve_two_point_by_segments(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition&,
                                      double least_condition);

}  // namespace bromwich
