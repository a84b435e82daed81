#pragma once
// Whether a small complementarity problem has more than one solution.

#include "matrix.hpp"

#include <Eigen/LU>

#include <optional>
#include <vector>

namespace bromwich {

inline constexpr Index largest_searched = 8;  ///< constraints: all active sets
inline constexpr Index largest_moved = 48;    ///< likewise: solutions next to one, by factorizations for each

/// Of problems with one M: the factors of its principal submatrices are kept.
class SolutionsBeside {
 public:
  explicit SolutionsBeside(const Matrix& M);

  /// As another_solution.
  std::optional<Vector> nearest(const Vector& q, const Vector& y, bool at_corners) const;

 private:
  struct RegularSet {
    std::vector<Index> active;
    Eigen::PartialPivLU<Matrix> lu;
  };
  Matrix M_;
  std::vector<RegularSet> sets_;  ///< none with n > 8
};

/// The nearest solution of LCP(q, M) that differs from the solution y by more than 1e-6 of the largest entry of both.
/// Empty if there is none. On active sets with a singular M_SS, and on all with n > 8, only directions in which y
/// itself can move are searched. `at_corners`: also those in which a y_i = 0 with w_i = 0 grows, such as both voltages
/// of an open switch.
std::optional<Vector> another_solution(const Matrix& M, const Vector& q, const Vector& y, bool at_corners = false);

}  // namespace bromwich
