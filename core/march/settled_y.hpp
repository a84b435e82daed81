#pragma once
// y at time points behind a switch, where M leaves y to the dynamics.
//
// Where M is singular, y may jump when a constraint closes or opens. Inside a step the march knows the integral of y
// and the state at the end, and no more: y at the end of a step of Radau IIA whose constraint closes inside it is up to
// 8/3 of the true one. The state x_j behind the step knows y. Implicit Euler takes it on by brief parts d = h/64 and 2
// d,
//
//     x = (E/d - A)^{-1} (E x_j/d + f(t_j + d) + B y),   0 <= y ⊥ N x + M y + g(t_j + d) >= 0,
//
// and y_j = 2 y(d) - y(2d), moved by the least change to where M y + N x_j + g(t_j) = 0 holds on its active set.

#include "../kernel/discrete_problem.hpp"

#include <memory>

namespace bromwich {

class SettledY {
 public:
  /// The problem, its dynamics (a Kronecker sum written out as matrices) and F, f = F phi (m x k; empty without f),
  /// must outlive it.
  SettledY(const DiscreteProblem&, const LinearSystem&, const SparseMatrix& F);
  ~SettledY();

  /// Replaces y (n) of time point j, where the state is x (m): at t = 0 where y is not determined, at points with
  /// another active set than the one before, and behind steps with jumps of sources. Only where the new y solves the
  /// problem of its point to 1e-10. Call with increasing j from 0 on.
  void operator()(Index j, const Vector& x, Eigen::Ref<Vector> y);

 private:
  struct Brief;
  bool is_open_at_zero(const Vector& y) const;

  const DiscreteProblem& p_;
  const LinearSystem& dynamics_;
  const SparseMatrix& F_;
  std::unique_ptr<Brief> brief_;  ///< made when first needed
  Eigen::Array<bool, Eigen::Dynamic, 1> before_;
  double largest_ = 0;  ///< of y so far
};

/// Whether y is settled: M is not of class P, and the scene has at most 128 constraints and 20000 states.
bool settles_y(const DiscreteProblem&);

}  // namespace bromwich
