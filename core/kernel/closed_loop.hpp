#pragma once
// The state of a dense scene, stepped together with y instead of computed from it.
//
// With y given, x_j = E x_{j-1} + L u_{j-1} + R u_j, u = B y + f. Rounding errors of y grow in it like the free state,
// by e^{lambda T} for an eigenvalue lambda > 0 of A, although y stabilises the state. Therefore the active rows S of y
// are solved again at every step for the state of this march:
//
//     delta_S = -(M + N R B)_SS^{-1} (M y_j + N x_j + g_j)_S,   y_j -> y_j + delta,   x_j -> x_j + R B delta.
//
// Errors then grow only as in the closed loop; delta is the error of y.

#include "discrete_problem.hpp"

#include <Eigen/QR>

namespace bromwich {

/// -(M + W_0)_SS^{-1} v_S for the active set S of a row of y; the factorization is kept while the set stays.
class ActiveResponse {
 public:
  explicit ActiveResponse(const Matrix& implicit) : implicit_(implicit), response_(Vector::Zero(implicit.rows())) {}

  /// Takes the active set of a row of y; returns whether it has changed.
  bool take(const Eigen::Ref<const Vector>& y);
  const Vector& to(const Vector& v);
  /// The same for all columns of a matrix: n x k.
  Matrix to_columns(const Matrix& v) const;

 private:
  Matrix implicit_;
  std::vector<Index> support_;
  Eigen::CompleteOrthogonalDecomposition<Matrix> lu_;  // duplicated constraints leave M_SS singular
  Vector response_;
};

/// Largest growth of the free state within [0, T], from the powers E, E^2, E^4, ... in balanced units, up to the first
/// above `harmless_growth`. 1 if the numerical range shows that it stays below.
double free_growth(const DiscreteProblem&, const StepOperators&);

/// Up to this growth the state is computed from y directly; rounding of y costs few digits.
inline constexpr double harmless_growth = 1e3;

struct StatesOfY {
  RowMatrix x;            ///< (J+1) x m; NaN from the first invalid row of y on
  double correction = 0;  ///< largest delta relative to the largest y; 0 if the state was computed from y directly
};

/// States of dense dynamics; y comes from the recurrence of the rule. Uses the given defects, or those of the problem.
StatesOfY states_of(const DiscreteProblem&, Rule, const RowMatrix& y, const StepDefects* = nullptr);

}  // namespace bromwich
