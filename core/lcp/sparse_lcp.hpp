#pragma once
// Complementarity problems with a sparse M of many rows, never written out as dense.
//
// Projected successive over-relaxation, y_i <- max(0, y_i - omega w_i / m_ii), one row after the other:
//
//   H+          converges for 0 < omega < 2 / (1 + rho), rho the spectral radius of |D^{-1}(M - D)| (below 1)
//   symmetric positive definite   converges for 0 < omega < 2
//
// (Cottle, Pang, Stone, The Linear Complementarity Problem, section 5.2; Ahn, J. Optim. Theory Appl. 33, 1981.) Both
// are P. For M with neighbours on a grid, omega = 2 / (1 + sqrt(1 - rho^2)) takes a number of sweeps that grows like
// the root of the condition. Problems that the sweeps leave unsolved are solved by active sets with sparse
// factorizations of M_SS.

#include "active_set.hpp"

#include <Eigen/SparseLU>

#include <string>

namespace bromwich {

struct SweepPlan {
  bool converges = false;
  double omega = 1;
  double radius = 0;  ///< rho, or an upper estimate
  std::string why;    ///< the class, or why there is none
};

/// Which class M has and the relaxation for it. The class is tested, whatever the user states.
SweepPlan plan_sweeps(const SparseMatrix& M);

/// One problem by semismooth Newton on min(y, w): active sets S = {y > w}, M_SS factorized. For an M-matrix the sets
/// are monotone, so that it ends.
class SparseActiveSet {
 public:
  /// M must outlive the solver.
  explicit SparseActiveSet(const SparseMatrix& M) : M_(M) {}
  /// y in SOL(q, M), from the active set of the given y. Not solved: the sets repeat, or some M_SS is singular.
  LcpOutcome solve(const Vector& q, Vector& y);

 private:
  const SparseMatrix& M_;
};

/// max_i |min(y_i, w_i)| / (|q_i| + |M| y): rounding of an exact solution is some 1e-15.
double relative_natural_residual(const SparseMatrix& M, const Vector& q, const Vector& y);

}  // namespace bromwich
