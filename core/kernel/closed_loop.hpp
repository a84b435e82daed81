#pragma once
// The state behind a solution y of a dense scene, stepped together with y instead of after it.
//
// x_j = E x_{j-1} + L u_{j-1} + R u_j with u = B y + f for given y lets every rounding error of y grow as the free
// state does, by e^{lambda T} for an eigenvalue lambda > 0 of A, although y holds the state back. So the rows S of y
// that are active are solved again at every step for the state that this march has itself:
//
//     delta_S = -(M + N R B)_SS^{-1} (M y_j + N x_j + g_j)_S,   y_j -> y_j + delta,   x_j -> x_j + R B delta.
//
// What is left of the errors is what the closed loop makes of them, and delta is the error of y.

#include "discrete_problem.hpp"

#include <Eigen/QR>

namespace bromwich {

/// -(M + W_0)_SS^{-1} v_S for the active set S of a row of y; the factorization is kept while the set stays.
class ActiveResponse {
 public:
  explicit ActiveResponse(const Matrix& implicit) : implicit_(implicit), response_(Vector::Zero(implicit.rows())) {}

  /// Takes the active set of a row of y; whether it is another one than before.
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

/// Largest growth of the free state within [0, T], from its powers E, E^2, E^4, ... in balanced units, up to the first
/// above `harmless_growth`; 1 where the numerical range shows that it stays below that.
double free_growth(const DiscreteProblem&, const StepOperators&);

/// Up to this growth the rounding of y leaves the state its digits, and y gives it directly.
inline constexpr double harmless_growth = 1e3;

struct StatesOfY {
  RowMatrix x;            ///< (J+1) x m; NaN from the first row of y on that is not valid
  double correction = 0;  ///< largest delta relative to the largest y; 0 where y gave the state directly
};

/// Dense dynamics, y of the recurrence of the rule; with the defects given, or else those of the problem.
StatesOfY states_of(const DiscreteProblem&, Rule, const RowMatrix& y, const StepDefects* = nullptr);

}  // namespace bromwich
