#pragma once
// Many small nonlinear complementarity problems at once: for every problem k
//
//     0 <= y_k  ⊥  F_k(y_k) >= 0,   y_k in R^n.
//
// Josephy-Newton: each iteration solves LCP(F_k(y) - J y, J) with the Jacobian J at y (Josephy 1979). Where this does
// not reduce max |min(d_i y_i, F_i)|, d the diagonal of J, the step is halved. y stays nonnegative, so F_k is evaluated
// at y >= 0 only. Where F_k is affine the first iteration ends.
//
// The batches of a backend (core/seam/plans.hpp) share one matrix. Here the Jacobian differs from problem to problem,
// and F_k is a function of the host, so these problems are divided among the threads of the host.

#include "../core/base/threads.hpp"

#include <functional>

namespace bromwich {

struct NcpBatch {
  using Values = std::function<void(Index problem, const Eigen::Ref<const Vector>& y, Eigen::Ref<Vector> value)>;
  using Jacobian =
      std::function<void(Index problem, const Eigen::Ref<const Vector>& y, Eigen::Ref<Vector> value, Matrix& jacobian)>;

  Index problems = 0;
  Values F;
  Jacobian F_and_jacobian;
  double tolerance = 1e-12;  ///< of the last change, relative to the largest |y_i| of the problem
  Index most_newton = 60;
};

struct NcpReport {
  Index solved = 0;
  Index newton = 0;           ///< iterations of all problems
  Index first_unsolved = -1;  ///< problem; -1: none
};

/// y: problems x n, the guesses on entry (negative ones count as 0). A problem that is not solved leaves its last
/// iterate. The threads call F and F_and_jacobian concurrently.
NcpReport solve_ncps(const NcpBatch&, const HostThreads&, RowMatrix& y);

}  // namespace bromwich
