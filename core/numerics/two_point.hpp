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

#include "boundary_condition.hpp"

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
/// them to `least_condition`. With many states x_0 by a Krylov method, where that ends; otherwise in blocks of steps,
/// shorter ones where rounding grows too much.
RowMatrix solve_two_point(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition&,
                          double least_condition);

/// Blocks of `length` steps, the last one as long as what is left. Block b begins with state b length:
///
///     x_last = Phi x_first + phi.
///
/// Between blocks by segments, inside them forward, with a bound of the rounding carried along.
inline Index count_blocks(Index N, Index length) { return (N + length - 1) / length; }

/// Phi (left out where null) and phi of the steps first+1 .. last.
void condense_steps(const std::vector<const Matrix*>& P, const RowMatrix& p, Index first, Index last, Matrix* Phi,
                    Eigen::Ref<Vector> phi);

/// How blocks end when each is carried forward from its first state: blocks x m each.
struct BlockEnds {
  explicit BlockEnds(Index blocks, Index m) : state(blocks, m), error(blocks, m), largest(blocks, m) {}
  RowMatrix state;
  RowMatrix error;    ///< bound of what rounding adds up to inside the block
  RowMatrix largest;  ///< absolute values of the block
};

/// Rows first+1 .. last-1 of x from row `first`, and row `block` of `ends`.
void expand_steps(const std::vector<const Matrix*>& P, const RowMatrix& p, Index first, Index last, Index block,
                  RowMatrix& x, BlockEnds& ends);

/// Every block ends where the next one begins, `starts` being (blocks+1) x m, and rounding inside blocks stays below
/// 1e-12 + 8 eps length of the largest value of the component.
bool blocks_meet(const RowMatrix& starts, const BlockEnds&, Index length);

/// The lengths to be tried in turn; below the last, by segments alone.
inline constexpr Index block_lengths[] = {128, 8};
/// Reciprocal condition below which the ends need every digit: blocks of one step.
inline constexpr double least_block_condition = 1e-4;

/// (E0 + ET P_N ... P_1) x_0 = b - ET phi_N by GMRES: a product with the matrix is one pass over the steps, O(N m^2),
/// and dissipative steps leave few directions that come around. Empty where 100 products are not enough or what comes
/// out does not satisfy the boundary condition to 1e-11.
RowMatrix solve_two_point_krylov(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition&);
inline constexpr Index fewest_krylov_states = 64;

/// The other two by themselves; in blocks: empty where blocks do not meet.
RowMatrix solve_two_point_in_blocks(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition&,
                                    double least_condition, Index length);
RowMatrix solve_two_point_by_segments(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition&,
                                      double least_condition);

}  // namespace bromwich
