#pragma once
// The solution of least Euclidean norm of LCP(q, M), M positive semidefinite.
//
// y_eps in SOL(q, M + eps I) tends to it as eps -> 0 (Tikhonov), with one active set S for all small eps. On S the
// limit is y_S = M_SS^+ (-q_S): a positive semidefinite M_SS has the same null space as its transpose, so (M_SS + eps
// I)^{-1} tends to the pseudoinverse on its range. So S determines the exact limit. S is correct if the first-order
// term of y_eps = y + eps y' + ... satisfies
//
//     y'_S = -M_SS^+ y_S,  w' = M y' + y;   y'_i >= 0 where y_i = 0, w'_i >= 0 where w_i = 0.
//
// (Then y + eps y' solves the Tikhonov problem up to eps^2 y', whose modulus of monotonicity is eps: the limit is y.)
//
// A monotone problem without a solution has no feasible point, so v >= 0 with M^T v <= 0 and q^T v < 0 exists (Farkas).
// v = lim eps y_eps is one: v_S = -(I - M_SS M_SS^+) q_S.

#include "matrix.hpp"

#include <functional>
#include <utility>

namespace bromwich {

struct LeastNorm {
  bool solved = false;
  bool infeasible = false;  ///< proven by a v as above, up to rounding
  int problems = 0;         ///< active sets tried
  Vector y;
};

/// Solves LCP(q, P) for a definite P; returns whether it did, and the number of active sets tried.
using DefiniteSolver = std::function<std::pair<bool, int>(const Matrix& P, const Vector& q, Vector& y)>;

/// M and q may have any scale.
LeastNorm least_norm_solution(const Matrix& M, const Vector& q, const DefiniteSolver&);

}  // namespace bromwich
