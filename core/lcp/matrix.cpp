#include "core/lcp/matrix.hpp"

#include <utility>

namespace bromwich {

SparseLcpMatrix::SparseLcpMatrix(SparseMatrix M) {
  M.makeCompressed();
  entries = std::make_shared<const SparseMatrix>(std::move(M));
}

Index size(const LcpMatrix& M) {
  if (const auto* dense = std::get_if<Matrix>(&M)) return dense->rows();
  if (const auto* sparse = sparse_of(M)) return sparse->rows();
  return std::get<Tridiagonal>(M).diagonal.size();
}

Vector diagonal(const LcpMatrix& M) {
  if (const auto* dense = std::get_if<Matrix>(&M)) return dense->diagonal();
  if (const auto* sparse = sparse_of(M)) return sparse->diagonal();
  return std::get<Tridiagonal>(M).diagonal;
}

Matrix to_dense(const LcpMatrix& M) {
  if (const auto* dense = std::get_if<Matrix>(&M)) return *dense;
  if (const auto* sparse = sparse_of(M)) return Matrix(*sparse);
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
  if (const auto* sparse = sparse_of(M)) return *sparse * y;
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
