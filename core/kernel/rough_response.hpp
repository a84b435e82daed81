#pragma once
// Response to f on rough steps beyond its linear interpolant between grid points, as a separate state:
//
//     x_e' = A x_e + e,    e = f - (linear interpolant) on rough steps, 0 elsewhere.
//
// Methods that use a kernel and never form the state add N x_e to r, and x_e to x.

#include "discrete_problem.hpp"
#include "recurrence.hpp"

#include <functional>
#include <vector>

namespace bromwich {

/// The coefficients of e on the pieces of a rough step: those of f minus the linear interpolant.
std::vector<Matrix> beyond_linear(const DiscreteProblem&, const RoughStep&);

/// x_e of a Kronecker sum at t_j in both sine bases (K x n), for j from the first rough step to `last`; 0 before.
void each_rough_state(const DiscreteProblem&, Index last,
                      const std::function<void(Index j, const RowMatrix& x)>& visit);

/// N x_e, (J+1) x n. Kronecker sums: exact, in modes. Null for sparse dynamics, whose kernel contains it.
std::shared_ptr<const RowMatrix> rough_response(const DiscreteProblem&);

/// ∫_0^h e^{(h-s)A} e(s) ds on a rough step for every pair of sine modes, including b: K x n, k across, l along.
RowMatrix modal_defect(const DiscreteProblem&, const RoughStep&);

/// The linear function of s/d, constant coefficient first (k x 2), with the mean and the first moment of f on (a, a +
/// d). Empty if f has no pieces there.
Matrix linear_by_moments(const RoughStep&, double a, double d);

/// Values of that function for f at both ends of a rough step (width of f x 2). Empty as above.
Matrix ends_by_moments(const DiscreteProblem&, const RoughStep&);

/// Sparse dynamics: the response to the function that is linear on every rough step and has the mean and first moment
/// of e there, from the lag weights of f. S_d is the response to a function falling from 1 at 0 to 0 at h; W_d - S_d is
/// the response to the other half of the hat.
RowMatrix rough_response(const DiscreteProblem&, const LagTable& response);

}  // namespace bromwich
