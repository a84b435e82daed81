#include "core/lcp/matrix.hpp"

namespace bromwich {

Index size(const LcpMatrix& M) {
  const auto* dense = std::get_if<Matrix>(&M);
  return dense ? dense->rows() : std::get<Tridiagonal>(M).diagonal.size();
}

Vector diagonal(const LcpMatrix& M) {
  if (const auto* t = std::get_if<Tridiagonal>(&M)) return t->diagonal;
  return std::get<Matrix>(M).diagonal();
}

Matrix to_dense(const LcpMatrix& M) {
  if (const auto* dense = std::get_if<Matrix>(&M)) return *dense;
  const auto& t = std::get<Tridiagonal>(M);
  const Index n = t.diagonal.size();
  Matrix dense = t.diagonal.asDiagonal();
  if (n > 1) {
    dense.diagonal(-1) = t.lower.tail(n - 1);
    dense.diagonal(1) = t.upper.head(n - 1);
  }
  return dense;
}

Vector multiply(const LcpMatrix& M, const Vector& y) {
  if (const auto* dense = std::get_if<Matrix>(&M)) return *dense * y;
  const auto& t = std::get<Tridiagonal>(M);
  const Index n = y.size();
  Vector product = t.diagonal.cwiseProduct(y);
  if (n > 1) {
    product.tail(n - 1) += t.lower.tail(n - 1).cwiseProduct(y.head(n - 1));
    product.head(n - 1) += t.upper.head(n - 1).cwiseProduct(y.tail(n - 1));
  }
  return product;
}

}  // namespace bromwich
