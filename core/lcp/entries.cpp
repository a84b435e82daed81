#include "core/lcp/entries.hpp"

#include <Eigen/LU>
#include <Eigen/SparseLU>

#include <vector>

namespace bromwich {

namespace {

// With fewer than three digits of a known solution M counts as singular.
bool finds_known_solution(const SparseMatrix& M) {
  if (M.rows() == 0) return true;
  Eigen::SparseLU<SparseMatrix> lu;
  lu.compute(M);
  if (lu.info() != Eigen::Success) return false;
  const Vector u = Vector::NullaryExpr(M.rows(), [](Index i) { return i % 3 == 0 ? -1.0 : 1.0; });
  const Vector found = lu.solve(Vector(M * u));
  return (found - u).cwiseAbs().maxCoeff() < 1e-3;
}

SparseMatrix banded(const Tridiagonal& t) {
  std::vector<Eigen::Triplet<double>> entries;
  each_entry(t, [&](Index i, Index j, double value) { entries.emplace_back(i, j, value); });
  SparseMatrix M(t.diagonal.size(), t.diagonal.size());
  M.setFromTriplets(entries.begin(), entries.end());
  return M;
}

}  // namespace

bool is_zero(const LcpMatrix& M) {
  if (const auto* dense = std::get_if<Matrix>(&M)) return dense->isZero(0);
  bool zero = true;
  const auto look_at = [&zero](double value) { zero = zero && value == 0; };
  if (const SparseMatrix* sparse = sparse_of(M)) {
    for (Index j = 0; j < sparse->outerSize(); ++j)
      for (SparseMatrix::InnerIterator a(*sparse, j); a; ++a) look_at(a.value());
  } else {
    each_entry(std::get<Tridiagonal>(M), [&](Index, Index, double value) { look_at(value); });
  }
  return zero;
}

bool is_regular(const LcpMatrix& M) {
  if (const auto* dense = std::get_if<Matrix>(&M)) return Eigen::FullPivLU<Matrix>(*dense).isInvertible();
  const SparseMatrix* sparse = sparse_of(M);
  return finds_known_solution(sparse ? *sparse : banded(std::get<Tridiagonal>(M)));
}

}  // namespace bromwich
