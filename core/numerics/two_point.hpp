#pragma once
// Linear two-point boundary problems in steps,
//
//     x_k = P_k x_{k-1} + p_k,  k = 1..N,     E0 x_0 + ET x_N = b,
//
// by orthogonal elimination of the inner states. A segment from i to j is condensed to V x_i + U x_j = r. Two adjacent
// segments share a state, which a QR factorization of [U_1; V_2] eliminates (S. J. Wright, SIAM J. Sci. Stat. Comput.
// 13, 1992). No products of P_k are formed, so modes that grow or decay by e^{1000} are computed stably if the boundary
// condition determines them. If it does not, the last 2m x 2m system is ill-conditioned.

#include "bromwich/scene.hpp"

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

/// `first` and `second` as one segment; `inner`, if given, receives the shared state.
Segment joined(const Segment& first, const Segment& second, InnerState* inner = nullptr);

/// N equal steps x_k = P x_{k-1} + p in O(log N) operations.
Segment repeated(const Matrix& P, const Vector& p, Index N);

/// x_0 and x_N from a segment over all steps and the boundary condition.
struct EndStates {
  Vector first, last;
  double reciprocal_condition = 0;  ///< of the 2m x 2m system after equilibration; 0 if singular
};
EndStates solve_ends(const Segment&, const BoundaryCondition&);

/// All states, (N+1) x m; P has N pointers, p is N x m. Empty (no rows) if the reciprocal condition is below
/// `least_condition`, or if rounding spoils the steps. With many states x_0 by a Krylov method, with few in blocks of
/// steps, shorter ones if rounding grows too much; if these fail, by segments. In units of its own: those of the states
/// do not matter.
RowMatrix solve_two_point(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition&,
                          double least_condition);

/// Blocks of `length` steps; the last one may be shorter. Block b begins with state b length:
///
///     x_last = Phi x_first + phi.
///
/// Segments solve for the states between blocks; inside a block the states are computed forward, with a bound of the
/// rounding error.
inline Index count_blocks(Index N, Index length) { return (N + length - 1) / length; }

/// Phi (omitted if null) and phi of the steps first+1 .. last.
void condense_steps(const std::vector<const Matrix*>& P, const RowMatrix& p, Index first, Index last, Matrix* Phi,
                    Eigen::Ref<Vector> phi);

/// Last states of blocks, each computed forward from its first state: blocks x m each.
struct BlockEnds {
  explicit BlockEnds(Index blocks, Index m) : state(blocks, m), error(blocks, m), largest(blocks, m) {}
  RowMatrix state;
  RowMatrix error;    ///< bound of the accumulated rounding error inside the block
  RowMatrix largest;  ///< absolute values of the block
};

/// Rows first+1 .. last-1 of x from row `first`, and row `block` of `ends`.
void expand_steps(const std::vector<const Matrix*>& P, const RowMatrix& p, Index first, Index last, Index block,
                  RowMatrix& x, BlockEnds& ends);

/// Every block ends at the first state of the next one, and rounding errors inside blocks are below
/// 1e-12 + 8 eps length of the largest value of the component. `starts`: (blocks+1) x m.
bool blocks_meet(const RowMatrix& starts, const BlockEnds&, Index length);

/// The lengths in the order in which they are tried; if all fail, segments only.
inline constexpr Index block_lengths[] = {128, 8};
/// Reciprocal condition below which blocks are not used: x_0 and x_N then need the accuracy of segments.
inline constexpr double least_block_condition = 1e-4;

/// (E0 + ET P_N ... P_1) x_0 = b - ET phi_N by GMRES. A product with the matrix is one pass over the steps, O(N m^2);
/// with dissipative steps few directions remain. Empty if 100 products are not enough, or if the result does not
/// satisfy the boundary condition to 1e-11.
RowMatrix solve_two_point_krylov(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition&);
inline constexpr Index fewest_krylov_states = 64;

/// The other two ways separately. In blocks: empty if the blocks do not match.
RowMatrix solve_two_point_in_blocks(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition&,
                                    double least_condition, Index length);
RowMatrix solve_two_point_by_segments(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition&,
                                      double least_condition);

}  // namespace bromwich
