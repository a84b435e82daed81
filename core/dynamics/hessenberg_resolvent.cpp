// The resolvent of a small matrix at many nodes. With A = Q H Q^T, Q orthogonal and H upper Hessenberg,
//
//     N (zI - A)^{-1} B = (N Q) (zI - H)^{-1} (Q^T B),
//
// each node needs an elimination in which the pivot is one of two neighbouring rows. Eight nodes are eliminated side by
// side, each with its own pivots.
//
// symbol   variable   shape                     meaning
// zI - H   T_         m x m                     rows of all nodes of a group, then those of its elimination
// X        X_         m x k                     Q^T B, then the solutions
// N Q      outputs_   n x m
//
// Source: Laub, "Efficient multivariable frequency response computations", IEEE Trans. Automat. Control 26 (1981).

#include "core/dynamics/hessenberg_resolvent.hpp"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <vector>

namespace bromwich {

namespace {

constexpr Index lanes = 8;
using Lane = Eigen::Array<double, lanes, 1>;

/// A complex number for each of eight nodes.
struct Number {
  Lane re, im;
};

Number product(const Number& a, const Number& b) { return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re}; }

Number reciprocal(const Number& a) {
  const Lane size = a.re.square() + a.im.square();
  return {a.re / size, -a.im / size};
}

void subtract_product(const Number& a, const Number& b, Number& from) {
  from.re -= a.re * b.re - a.im * b.im;
  from.im -= a.re * b.im + a.im * b.re;
}

class Elimination {
 public:
  Elimination(const Matrix& A, const Matrix& B, const Matrix& N)
      : m_(A.rows()), k_(B.cols()), H_(A), inputs_(B), outputs_(N), T_(std::size_t(m_ * m_)), X_(std::size_t(m_ * k_)) {
    if (m_ < 3) return;  // every matrix is Hessenberg
    const Eigen::HessenbergDecomposition<Matrix> form(A);
    const Matrix Q = form.matrixQ();
    H_ = form.matrixH();
    inputs_ = Q.transpose() * B;
    outputs_ = N * Q;
  }

  void solve(const Number& z) {
    for (Index i = 0; i < m_; ++i) {
      for (Index j = std::max<Index>(i - 1, 0); j < m_; ++j) T(i, j) = {Lane::Constant(-H_(i, j)), Lane::Zero()};
      T(i, i).re += z.re, T(i, i).im += z.im;
      for (Index c = 0; c < k_; ++c) X(i, c) = {Lane::Constant(inputs_(i, c)), Lane::Zero()};
    }
    for (Index i = 0; i + 1 < m_; ++i) eliminate(i);
    for (Index i = m_ - 1; i >= 0; --i) {
      const Number inverse = reciprocal(T(i, i));
      for (Index c = 0; c < k_; ++c) {
        for (Index j = i + 1; j < m_; ++j) subtract_product(T(i, j), X(j, c), X(i, c));
        X(i, c) = product(X(i, c), inverse);
      }
    }
  }

  // Entry (r, c) of N Q X.
  Number output(Index r, Index c) const {
    Number sum{Lane::Zero(), Lane::Zero()};
    for (Index i = 0; i < m_; ++i) {
      sum.re += outputs_(r, i) * X_[std::size_t(i * k_ + c)].re;
      sum.im += outputs_(r, i) * X_[std::size_t(i * k_ + c)].im;
    }
    return sum;
  }

 private:
  Number& T(Index i, Index j) { return T_[std::size_t(i * m_ + j)]; }
  Number& X(Index i, Index c) { return X_[std::size_t(i * k_ + c)]; }

  // Row i + 1 minus a multiple of row i, after they are exchanged where the lower one has the larger entry.
  void eliminate(Index i) {
    const auto size = [](const Number& a) -> Lane { return a.re.abs() + a.im.abs(); };
    const Eigen::Array<bool, lanes, 1> swaps = size(T(i + 1, i)) > size(T(i, i));
    const auto exchange = [&](Number& a, Number& b) {
      const Number upper{swaps.select(b.re, a.re), swaps.select(b.im, a.im)};
      b = {swaps.select(a.re, b.re), swaps.select(a.im, b.im)};
      a = upper;
    };
    exchange(T(i, i), T(i + 1, i));
    const Number factor = product(T(i + 1, i), reciprocal(T(i, i)));
    for (Index j = i + 1; j < m_; ++j) {
      exchange(T(i, j), T(i + 1, j));
      subtract_product(factor, T(i, j), T(i + 1, j));
    }
    for (Index c = 0; c < k_; ++c) {
      exchange(X(i, c), X(i + 1, c));
      subtract_product(factor, X(i, c), X(i + 1, c));
    }
  }

  Index m_, k_;
  Matrix H_, inputs_, outputs_;
  std::vector<Number, Eigen::aligned_allocator<Number>> T_, X_;
};

}  // namespace

ComplexMatrix hessenberg_resolvent(const Matrix& A, const Matrix& B, const Matrix& N, const ComplexVector& nodes) {
  const Index n = N.rows(), k = B.cols(), count = nodes.size();
  ComplexMatrix R(count, n * k);
  Elimination elimination(A, B, N);
  for (Index first = 0; first < count; first += lanes) {
    const Index here = std::min(lanes, count - first);
    Number z;
    for (Index p = 0; p < lanes; ++p) {
      const Complex node = nodes[first + std::min(p, here - 1)];
      z.re[p] = node.real(), z.im[p] = node.imag();
    }
    elimination.solve(z);
    for (Index r = 0; r < n; ++r)
      for (Index c = 0; c < k; ++c) {
        const Number entry = elimination.output(r, c);
        for (Index p = 0; p < here; ++p) R(first + p, r * k + c) = {entry.re[p], entry.im[p]};
      }
  }
  return R;
}

}  // namespace bromwich
