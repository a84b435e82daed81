#pragma once
// The response to x0 of a Kronecker sum, Σ_k n^_k e^{t (mu + nu_k)} x^0_k in modes, by all eigenvalues, and the
// transposed operation. Both take sixteen time points at a time. Exponentials are left out from where they are nothing
// beside their own start and beside the slowest one of the mode.

#include "../core/dynamics/dynamics.hpp"

namespace bromwich {

class ModalStart {
 public:
  static constexpr Index together = 16;  ///< time points, which the registers hold

  ModalStart(const KroneckerDynamics&, double h);

  /// The terms of the sum for this x0, K x n in modes, at t = 0. Columns are filled up to whole vectors.
  RowMatrix terms(const RowMatrix& x0) const;
  /// Their sums at time points first, first + 1, ... into up to `together` rows of as many columns as `terms` has, and
  /// `terms` to the time point `first + together`.
  void advance(Index first, RowMatrix& terms, Eigen::Ref<RowMatrix> rows) const;

  /// Zero, K x columns.
  RowMatrix nothing() const { return RowMatrix::Zero(decay_.rows(), decay_.cols()); }
  /// q <- Σ_i e^{i h (mu + nu)} rho_i + e^{together h (mu + nu)} q for rows rho_i of time points first + i, of which
  /// there are fewer than `together` at the end only.
  void retreat(Index first, const Eigen::Ref<const RowMatrix>& rho, RowMatrix& q) const;
  /// The gradient with respect to x0, K x n, from q at t = 0.
  RowMatrix gradient(const RowMatrix& q) const;

  /// All rows of the response to x0, (J+1) x n.
  RowMatrix response(const RowMatrix& x0, Index J) const;
  /// The transposed: `rho` (J+1) x n, the result K x n.
  RowMatrix transposed(const RowMatrix& rho) const;

 private:
  Index n_;
  Vector seen_;      ///< K, n^
  RowMatrix decay_;  ///< K x n, e^{h (mu + nu_k)}
  RowMatrix ends_;   ///< K x vectors of columns: rows of time points from which on all their terms are left out
};

}  // namespace bromwich
