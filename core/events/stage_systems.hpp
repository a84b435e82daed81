#pragma once
// The linear systems of a step of Radau IIA with s stages and the matrix A of a mode:
//
//     X = R + h S X A^T,    X, R: s x m,  S: the Radau matrix, s x s.
//
// In the eigenvectors of S they are shifted systems (I - h lambda_k A) x = r. A = T H T^{-1} with an upper Hessenberg
// matrix H is found once for a mode; a step of any length then costs O(m²) (Enright, ACM Trans. Math. Softw. 4, 1978;
// Varah, Math. Comp. 33, 1979). T is orthogonal but for powers of two, so errors are relative to the largest
// components: callers refine with A itself. States that do not depend on others stay free of their rounding: A is
// solved by its strongly connected blocks.

#include "collocation.hpp"

#include <vector>

namespace bromwich {

class StageSystems {
 public:
  static constexpr Index degree = Collocation::degree;
  using AtStages = Eigen::Matrix<double, degree, Eigen::Dynamic>;

  explicit StageSystems(const Matrix& A);

  /// X by R.
  void solve(double h, const AtStages& right, AtStages& x);

  /// Numbers kept for matrices of m states.
  static std::size_t size(Index m) { return std::size_t(8 * m * m); }

 private:
  using Lanes = Eigen::Array<double, (degree + 1) / 2, 1>;  ///< a value for each eigenvalue of S with Im >= 0
  struct ComplexLanes {
    Lanes re, im;
  };
  using Sides = Eigen::Matrix<double, degree + 1, Eigen::Dynamic>;  ///< real and imaginary parts below each other

  /// The systems of one block.
  class Block {
   public:
    explicit Block(const Matrix& A);
    void solve(double h, AtStages& x);

   private:
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
  struct Part {
    std::vector<Index> states, others;  ///< those on which the states depend
    Matrix by_others;
    Block block;
  };

  std::vector<Part> parts_;  ///< none depends on a later one
  AtStages part_, driven_;
};

}  // namespace bromwich
