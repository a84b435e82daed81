#pragma once
// The error of y at time points behind a switch, where M leaves y to the dynamics.
//
// Where M is singular, y may jump when a constraint closes or opens. Inside a step the march knows the integral of y
// and the state at the end, and no more: y at the end of a step of Radau IIA whose constraint closes inside it is up to
// 8/3 of the true one. The state x_j behind the step knows y. Implicit Euler takes it on by brief parts d = h/64 and 2
// d,
//
//     x = (I/d - A)^{-1} (x_j/d + f(t_j + d) + B y),   0 <= y ⊥ N x + M y + g(t_j + d) >= 0,
//
// and the settled y_j is 2 y(d) - y(2d), moved by the least change to where M y + N x_j + g(t_j) = 0 holds on its
// active set.

#include "../kernel/discrete_problem.hpp"
#include "../result/result.hpp"

namespace bromwich {

/// y of the result with settled rows: at time points with another active set than the one before, and behind steps with
/// jumps of sources. Only where the settled y solves the problem of its point to 1e-10; other rows are those of the
/// result. Dense dynamics; x all states, (J+1) x m. With M of class P, or a constraint of positions with M_ii = 0
/// (whose y is an impulse there), no row is settled.
RowMatrix settled_y(const DiscreteProblem&, const RowMatrix& x, const Result&);

/// Rows of y that differ from the settled ones by more than `share`, in their components relative to
/// max(max_t |y_i|, 1e-3 of the largest), and the largest difference.
struct UnsettledRows {
  Index count = 0, first = -1;
  double error = 0;
};
UnsettledRows unsettled_rows(const RowMatrix& y, const RowMatrix& settled, double share);

}  // namespace bromwich
