#pragma once
// Whether two matrices have the same values.

#include "matrix.hpp"

namespace bromwich {

inline bool same(const SparseMatrix& a, const SparseMatrix& b) {
  return a.rows() == b.rows() && a.cols() == b.cols() && (a.size() == 0 || SparseMatrix(a - b).norm() == 0);
}

inline bool same(const LcpMatrix& a, const LcpMatrix& b) {
  if (a.index() != b.index()) return false;
  if (const auto* dense = std::get_if<Matrix>(&a)) {
    const Matrix& other = std::get<Matrix>(b);
    return dense->rows() == other.rows() && dense->cols() == other.cols() && *dense == other;
  }
  if (const auto* sparse = sparse_of(a)) return same(*sparse, *sparse_of(b));
  const auto &s = std::get<Tridiagonal>(a), &t = std::get<Tridiagonal>(b);
  return s.diagonal.size() == t.diagonal.size() && s.diagonal == t.diagonal && s.lower == t.lower && s.upper == t.upper;
}

}  // namespace bromwich
