// The resolvent of a small matrix at many nodes: elimination with partial pivoting, eight nodes side by side, each with
// its own pivots. The largest entry of a column comes to its place by exchanges with one row after the other.
//
// symbol   variable   shape      meaning
// zI - A   T          m x m      of all nodes of a group, then U of the elimination
// X        X          m x k      B, then the solutions

#include "core/dynamics/small_resolvent.hpp"

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
  const Lane scale = a.re.abs() + a.im.abs();  // squares stay in range
  const Lane re = a.re / scale, im = a.im / scale, size = scale * (re.square() + im.square());
  return {re / size, -im / size};
}

void subtract_product(const Number& a, const Number& b, Number& from) {
  from.re -= a.re * b.re - a.im * b.im;
  from.im -= a.re * b.im + a.im * b.re;
}

class Elimination {
 public:
  Elimination(const Matrix& A, const Matrix& B, const Matrix& N)
      : m_(A.rows()), k_(B.cols()), A_(A), B_(B), N_(N), T_(std::size_t(m_ * m_)), X_(std::size_t(m_ * k_)) {}

  void solve(const Number& z) {
    for (Index i = 0; i < m_; ++i) {
      for (Index j = 0; j < m_; ++j) T(i, j) = {Lane::Constant(-A_(i, j)), Lane::Zero()};
      T(i, i).re += z.re, T(i, i).im += z.im;
      for (Index c = 0; c < k_; ++c) X(i, c) = {Lane::Constant(B_(i, c)), Lane::Zero()};
    }
    for (Index i = 0; i < m_; ++i) {
      for (Index row = i + 1; row < m_; ++row) exchange(i, row);
      const Number inverse = reciprocal(T(i, i));
      for (Index row = i + 1; row < m_; ++row) subtract(i, product(T(row, i), inverse), row);
    }
    for (Index i = m_ - 1; i >= 0; --i) {
      const Number inverse = reciprocal(T(i, i));
      for (Index c = 0; c < k_; ++c) {
        for (Index j = i + 1; j < m_; ++j) subtract_product(T(i, j), X(j, c), X(i, c));
        X(i, c) = product(X(i, c), inverse);
      }
    }
  }

  // Entry (r, c) of N X.
  Number output(Index r, Index c) const {
    Number sum{Lane::Zero(), Lane::Zero()};
    for (Index i = 0; i < m_; ++i) {
      sum.re += N_(r, i) * X_[std::size_t(i * k_ + c)].re;
      sum.im += N_(r, i) * X_[std::size_t(i * k_ + c)].im;
    }
    return sum;
  }

 private:
  Number& T(Index i, Index j) { return T_[std::size_t(i * m_ + j)]; }
  Number& X(Index i, Index c) { return X_[std::size_t(i * k_ + c)]; }

  // Exchanges row i with a later one where that has the larger entry in column i.
  void exchange(Index i, Index row) {
    const auto size = [](const Number& a) -> Lane { return a.re.abs() + a.im.abs(); };
    const Eigen::Array<bool, lanes, 1> swaps = size(T(row, i)) > size(T(i, i));
    if (!swaps.any()) return;
    const auto swap = [&](Number& a, Number& b) {
      const Number upper{swaps.select(b.re, a.re), swaps.select(b.im, a.im)};
      b = {swaps.select(a.re, b.re), swaps.select(a.im, b.im)};
      a = upper;
    };
    for (Index j = i; j < m_; ++j) swap(T(i, j), T(row, j));
    for (Index c = 0; c < k_; ++c) swap(X(i, c), X(row, c));
  }

  void subtract(Index i, const Number& factor, Index from) {
    for (Index j = i + 1; j < m_; ++j) subtract_product(factor, T(i, j), T(from, j));
    for (Index c = 0; c < k_; ++c) subtract_product(factor, X(i, c), X(from, c));
  }

  Index m_, k_;
  const Matrix &A_, &B_, &N_;
  std::vector<Number, Eigen::aligned_allocator<Number>> T_, X_;
};

}  // namespace

ComplexMatrix small_resolvent(const Matrix& A, const Matrix& B, const Matrix& N, const ComplexVector& nodes) {
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
