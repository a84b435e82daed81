#pragma once
// The linear systems of a step of Radau IIA with s stages and the matrix A of a mode:
//
//     X = R + h 𝒜 X A^T,    X, R: s x m,  𝒜 = Σ_k Re(...) with eigenvalues λ_k.
//
// In the eigenvectors of 𝒜 they are shifted systems (I - h λ_k A) x = r. A = T H T^{-1} with an upper Hessenberg
// matrix H is found once for a mode; a step of any length then costs O(m²) (Varah, Math. Comp. 33, 1979; Enright, ACM
// Trans. Math. Softw. 4, 1978). T is orthogonal but for powers of two, so errors are relative to the largest
// components: callers refine with A itself.

#include "collocation.hpp"

#include <vector>

namespace bromwich {

class StageSystems {
 public:
  static constexpr Index degree = Collocation::degree;
  using AtStages = Eigen::Matrix<double, degree, Eigen::Dynamic>;

  explicit StageSystems(const Matrix& A);

  /// X by R, which it may be.
  void solve(double h, const AtStages& right, AtStages& x);

  /// Numbers kept for matrices of m states.
  static std::size_t size(Index m) { return std::size_t(8 * m * m); }

 private:
  using Lanes = Eigen::Array<double, (degree + 1) / 2, 1>;  ///< a value for each eigenvalue of 𝒜 with Im >= 0
  struct ComplexLanes {
    Lanes re, im;
  };
  using Sides = Eigen::Matrix<double, degree + 1, Eigen::Dynamic>;  ///< real and imaginary parts below each other

  void factor(double h);
  ComplexLanes shifted(Index row, Index column) const;

  Matrix H_, to_, from_;  ///< X = X_H from_, X_H = X to_
  double h_ = 0;
  ComplexLanes z_;
  std::vector<ComplexLanes> upper_;                  ///< rows of U, one after the other, of I - z H = P L U
  std::vector<ComplexLanes> multipliers_, inverse_;  ///< of L; of the diagonal of U
  std::vector<Lanes> exchanged_;                     ///< 1 where rows k and k+1 were exchanged
  Sides sides_;
};

}  // namespace bromwich
