#pragma once
// The complementarity problem of a marching step on a face, 0 <= y  ⊥  (M + W_0) y + q >= 0, M a stencil or another
// sparse symmetric matrix, and W_0 = V diag(w0) V^T in modes:
//
//     y <- sweeps of LCP(M + D I, q + W_0 y - D y),
//
// a few sweeps of projected over-relaxation for each product with W_0, until y moves by rounding alone: in two colours
// for a stencil, row by row for another M. With D from w0 the iteration contracts by max_l |w0_l - D| / (M_l + D), 0.03
// for typical steps. M_l are the eigenvalues of a stencil, or Gershgorin's bound min_i m_ii - Σ |m_ij| of another M.
// The first iterate is the extrapolation of the last two solutions. Nothing of size n x n is formed.

#include "../lcp/active_set.hpp"
#include "../lcp/stencil.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace bromwich::host {

class FaceLcp {
 public:
  /// out = V^T in or V in, for n values each.
  using Transform = std::function<void(Way, const double* in, double* out)>;

  /// Nothing where M is dense or not symmetric, M + W_0 is not known to be positive definite, or the iteration
  /// contracts slowly.
  static std::unique_ptr<FaceLcp> make(const LcpMatrix& M, const FaceBasis&, const Vector& w0, Transform transform);

  void start_from(const Vector& y);
  LcpOutcome solve(const Vector& q, Vector& y);
  std::size_t bytes() const;

 private:
  FaceLcp(const Vector& w0, const InstantShift&, double omega, Transform);
  static std::unique_ptr<FaceLcp> make(const Stencil&, const Vector& w0, Transform);
  static std::unique_ptr<FaceLcp> make(const SparseMatrix& M, const Vector& w0, Transform);
  void take(const Stencil&);
  void take(const SparseMatrix& M);
  void relax();
  void relax_colour(int colour);
  void relax_rows();
  void to_padded(const Vector& values, Vector& padded) const;

  /// A line of points of the fastest direction: its first point in padded arrays and in others, and its colour.
  struct Line {
    Index padded, first;
    int colour;
  };

  Index n_, length_ = 0;
  Vector w0_;
  double shift_, centre_ = 0, omega_;
  std::vector<double> beside_;
  std::vector<Index> strides_;  ///< of padded arrays
  std::vector<Line> lines_;
  Eigen::SparseMatrix<double, Eigen::RowMajor> rows_;  ///< M + D I where it is no stencil
  Vector step_;                                        ///< omega over its diagonal
  Transform transform_;
  Vector y_, q_;  ///< padded by zeros
  Vector last_, before_, now_, right_, modes_;
};

}  // namespace bromwich::host
