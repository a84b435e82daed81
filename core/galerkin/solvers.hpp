#pragma once
// Solvers of the discrete Galerkin problem (core/galerkin/discretisation.hpp) without free unknowns.
//
// Initial values: the intervals one after the other (LCP(D, C x_{k-1} + q_k), exact). Boundary values are not causal:
// semismooth Newton on the whole problem. On a given active set S_k every interval is an affine map,
//
//     z_S = -D_SS^{-1} (C_S x + q_S),    x_k = (E - H_S D_SS^{-1} C_S) x_{k-1} + (F_k - H_S D_SS^{-1} q_S),
//
// so that a Newton step is a linear two-point problem of m x m matrices (core/numerics/two_point.hpp), solved exactly.
// Few different active sets occur, and their maps are kept.

#include "../result/options.hpp"
#include "../result/result.hpp"
#include "../seam/backend.hpp"
#include "discretisation.hpp"

namespace bromwich {

struct GalerkinSolution {
  Status status = Status::tolerance_not_met;
  std::string reason;  ///< if not solved
  std::string how;     ///< the solver, in words
  RowMatrix z;         ///< N x 2n
  RowMatrix x;         ///< (N+1) x m
  Index iterations = 0;
  Index infeasible = -1;  ///< interval, counted from 0
  bool iterated = false;  ///< history are changes of sweeps; otherwise the discrete problem is solved exactly
  bool unique = false;    ///< the problem has no other solution, for certain
  std::vector<double> history;
  LcpCount lcp;
  std::size_t bytes = 0;
  double lcp_seconds = 0;
};

/// Whether the user wants to stop; sets status and reason.
bool asked_to_stop(const Options&, GalerkinSolution&);

/// Status and reason of a march that stopped; `first`: the interval that the report counts as step 1.
void explain_stop(const GalerkinProblem&, Index first, const MarchReport&, GalerkinSolution&);

/// Interval by interval, on the backend. Precondition: initial values.
GalerkinSolution march_galerkin(const GalerkinProblem&, Backend&, const Options&);

/// Functional iteration, all intervals at once on the backend: z^{i+1}_k in SOL(D, q_k + C x_{k-1}(z^i)), x(z) by the
/// convolution of a recurrence. Preconditions: initial values, intervals of one length. Converges superlinearly; ends
/// as tolerance_not_met where the sweeps do not contract.
GalerkinSolution iterate_galerkin(const GalerkinProblem&, Backend&, const Options&);

/// Active sets of all intervals at once, exchanged until they repeat or agree (primal-dual active set method), those of
/// `start` first. After `most` two-point problems it ends with z and x of the last sets.
inline constexpr Index most_exchanges = 200;
GalerkinSolution exchange_active_sets(const GalerkinProblem&, Backend&, const Options&,
                                      const RowMatrix* start = nullptr, Index most = most_exchanges);

/// Newton's method on the initial state, from x0. Marching finds the active sets that belong to an initial state in one
/// pass, where exchanges move them by one interval at a time (M = 0). The two-point problem on these sets gives the
/// next initial state; the step is shortened where it would miss the boundary condition by more. Ends as
/// tolerance_not_met where marching does not reach T (growing modes).
GalerkinSolution shoot(const GalerkinProblem&, Backend&, const Options&, const Vector& x0);

/// Damped Newton method on the Fischer-Burmeister function, whose merit function is smooth: from anywhere, for singular
/// D_SS (M singular) too, finished by exchange_active_sets where its active sets are those of a solution.
GalerkinSolution damped_newton(const GalerkinProblem&, Backend&, const Options&, const RowMatrix& start);

/// Pivoting on the assembled 2nN x 2nN matrix: Lemke's method, or the least-norm solver where the problem is monotone,
/// which also proves that there is no solution. For `most_assembled` unknowns at most.
GalerkinSolution pivot_assembled(const GalerkinProblem&, const Options&);
inline constexpr Index most_assembled = 400;

/// First interval in which no z >= 0 and no state give w >= 0, or -1: such a problem has no solution, whatever the
/// boundary condition. The proof is a certificate by Farkas' lemma whose four conditions hold up to the rounding of
/// their own terms. Intervals in which (z, x) gives w >= 0 are passed over (z and x may be empty). Where checking all
/// others would take more than 1e10 operations, only those with the largest violations are checked, 256 at least.
Index first_infeasible_interval(const GalerkinProblem&, const Options&, const RowMatrix& z, const RowMatrix& x);

}  // namespace bromwich
