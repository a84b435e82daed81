#pragma once
// M^T + K^T in reversed time, for adjoint equations by the methods of the equations themselves. In row i = J + 1 - j,
//
//     w_j = (M^T y)_j + r_j + Σ_{k >= j} W_{k-j}^T y_k,   j = J, ..., 1,
//
// is a problem w = M^T y + r + K~ y with the weights W_d^T (core/kernel/transposed_kernel.hpp). Row 0 has no weights:
// y_0 has to be zero.

#include "time_operator.hpp"

namespace bromwich {

/// Of the weights of `of`, which has to outlive it, on the grid of `p`: the same grid and dynamics with M^T, without f,
/// and with r as g. Its states are not those of a scene: `states` throws Error. Precondition: no weights of few poles.
std::unique_ptr<TimeOperator> make_transposed_operator(const DiscreteProblem& p, TimeOperator& of);

}  // namespace bromwich
