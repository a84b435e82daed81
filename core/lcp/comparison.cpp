#include "core/lcp/comparison.hpp"

#include "core/lcp/solution.hpp"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <limits>

namespace bromwich {

namespace {

LcpMatrix absolute(const LcpMatrix& M) {
  if (const auto* t = std::get_if<Tridiagonal>(&M))
    return Tridiagonal{t->lower.cwiseAbs(), t->diagonal.cwiseAbs(), t->upper.cwiseAbs()};
  if (const auto* sparse = sparse_of(M)) return SparseLcpMatrix(sparse->cwiseAbs());
  return Matrix(std::get<Matrix>(M).cwiseAbs());
}

LcpMatrix comparison(const LcpMatrix& M) {
  if (const auto* t = std::get_if<Tridiagonal>(&M))
    return Tridiagonal{-t->lower.cwiseAbs(), t->diagonal.cwiseAbs(), -t->upper.cwiseAbs()};
  if (const auto* sparse = sparse_of(M)) {
    SparseMatrix C = *sparse;
    C.makeCompressed();
    for (Index j = 0; j < C.outerSize(); ++j)
      for (SparseMatrix::InnerIterator a(C, j); a; ++a)
        a.valueRef() = a.row() == j ? std::abs(a.value()) : -std::abs(a.value());
    return SparseLcpMatrix(std::move(C));
  }
  Matrix C = -std::get<Matrix>(M).cwiseAbs();
  C.diagonal() *= -1;
  return C;
}

}  // namespace

Comparison::Comparison(const LcpMatrix& M) : C_(comparison(M)) {
  if (const auto* dense = std::get_if<Matrix>(&C_); dense && dense->rows() > 0) lu_.compute(*dense);
  if (const auto* sparse = sparse_of(C_)) {
    sparse_lu_ = std::make_shared<Eigen::SparseLU<SparseMatrix>>();
    sparse_lu_->compute(*sparse);
  }
}

// Elimination without exchanges: a nonsingular M-matrix has positive pivots in any order.
Vector Comparison::solve_tridiagonal(const Vector& b) const {
  const Tridiagonal& t = std::get<Tridiagonal>(C_);
  const Index n = b.size();
  Vector c(n), u(n);
  for (Index i = 0; i < n; ++i) {
    const double pivot = t.diagonal[i] - (i > 0 ? t.lower[i] * c[i - 1] : 0);
    if (!(pivot > 0)) return Vector::Constant(n, -1);
    c[i] = i + 1 < n ? t.upper[i] / pivot : 0;
    u[i] = (b[i] - (i > 0 ? t.lower[i] * u[i - 1] : 0)) / pivot;
  }
  for (Index i = n - 2; i >= 0; --i) u[i] -= c[i] * u[i + 1];
  return u;
}

Vector Comparison::solve(const Vector& b) const {
  if (std::holds_alternative<Tridiagonal>(C_)) return solve_tridiagonal(b);
  if (sparse_lu_)
    return sparse_lu_->info() == Eigen::Success ? Vector(sparse_lu_->solve(b)) : Vector::Constant(b.size(), NAN);
  return b.size() > 0 ? Vector(lu_.solve(b)) : b;
}

bool Comparison::is_M_matrix() const {
  const Index n = size(C_);
  if (n == 0) return true;
  const Vector u = solve(diagonal(C_));
  if (!u.allFinite() || !(u.minCoeff() > 0)) return false;
  const double rounding = 4 * epsilon * double(std::holds_alternative<Tridiagonal>(C_) ? 3 : n);
  return (multiply(C_, u).array() > rounding * multiply(absolute(C_), u).array()).all();
}

}  // namespace bromwich
