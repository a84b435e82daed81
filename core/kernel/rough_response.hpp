#pragma once
// What f does on rough steps beyond its linear function between points of the grid, as a state of its own:
//
//     x_e' = A x_e + e,    e = f - (linear between points of the grid) on rough steps, 0 elsewhere,
//
// for methods that work with a kernel and never see the state: N x_e is added to r, and x_e to x.

#include "discrete_problem.hpp"
#include "recurrence.hpp"

#include <functional>
#include <vector>

namespace bromwich {

/// The coefficients of e on the pieces of a rough step: those of f, less the linear function.
std::vector<Matrix> beyond_linear(const DiscreteProblem&, const RoughStep&);

/// x_e of a Kronecker sum at t_j in both sine bases (K x n), for j from the first rough step to `last`; 0 before.
void each_rough_state(const DiscreteProblem&, Index last,
                      const std::function<void(Index j, const RowMatrix& x)>& visit);

/// N x_e, (J+1) x n. Kronecker sums: exact, in modes. Null for sparse dynamics, whose kernel holds it.
std::shared_ptr<const RowMatrix> rough_response(const DiscreteProblem&);

/// ∫_0^h e^{(h-s)A} e(s) ds on a rough step for every pair of sine modes, b included: K x n, k across, l along.
RowMatrix modal_defect(const DiscreteProblem&, const RoughStep&);

/// The linear function of s/d, constant first (k x 2), that has the mean and the first moment of f on (a, a + d).
/// Empty without pieces there.
Matrix linear_by_moments(const RoughStep&, double a, double d);

/// Sparse dynamics: the response to e where that has the mean and the first moment of e on every rough step and is
/// linear there, from the lag weights of f. S_d is the response to a function that falls from 1 at 0 to 0 at h, so that
/// W_d - S_d is that to the other half of a hat.
RowMatrix rough_response(const DiscreteProblem&, const LagTable& response);

}  // namespace bromwich
