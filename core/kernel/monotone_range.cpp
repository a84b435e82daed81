#include "core/kernel/monotone_range.hpp"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index largest = 1024;
constexpr double rank_rounding = 1e-11;  ///< of the largest eigenvalue: as in core/lcp/least_norm.cpp

double largest_eigenvalue(const Matrix& symmetric) {
  return Eigen::SelfAdjointEigenSolver<Matrix>(symmetric, Eigen::EigenvaluesOnly).eigenvalues().tail(1)[0];
}

// Whether |A U0| is rounding of |A| |U0|: null vectors of S are known to eps times the condition of S on its range.
bool vanishes(const SparseMatrix& A, const Matrix& null_space) {
  const SparseMatrix size = A.cwiseAbs();
  for (Index k = 0; k < null_space.cols(); ++k) {
    const Vector image = A * null_space.col(k), terms = size * null_space.col(k).cwiseAbs();
    const double most = terms.size() > 0 ? terms.maxCoeff() : 0;
    if (image.size() > 0 && image.cwiseAbs().maxCoeff() > rank_rounding * most) return false;
  }
  return true;
}

}  // namespace

double MonotoneRange::contraction(const Matrix& W) const {
  if (unscaled.cols() == 0) return 0;
  const Matrix inside = unscaled.transpose() * W * unscaled, square = inside.transpose() * inside;
  return std::sqrt(std::max(largest_eigenvalue(square), 0.0));
}

bool MonotoneRange::holds_definite(const Matrix& X) const {
  const Index r = basis.cols();
  if (r == 0) return true;
  const Matrix inside = basis.transpose() * X * basis, symmetric = 0.5 * (inside + inside.transpose());
  const Vector values = Eigen::SelfAdjointEigenSolver<Matrix>(symmetric, Eigen::EigenvaluesOnly).eigenvalues();
  return values[0] > rank_rounding * values.cwiseAbs().maxCoeff();
}

RangeOfM range_of_M(const LcpMatrix& M, LcpClass lcp_class, const SparseMatrix& B, const SparseMatrix& N) {
  if (!selects_least_norm(lcp_class)) return {};
  const Index n = size(M);
  if (n > largest) return {std::nullopt, "null spaces of more than 1024 constraints are not computed"};
  const Matrix dense = to_dense(M);
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(Matrix(0.5 * (dense + dense.transpose())));
  const Vector& values = eigen.eigenvalues();  // increasing
  const double limit = rank_rounding * std::max(values.cwiseAbs().maxCoeff(), 0.0);
  Index null = 0;
  while (null < n && values[null] <= limit) ++null;
  const Matrix null_space = eigen.eigenvectors().leftCols(null);
  if (!vanishes(B, null_space)) return {std::nullopt, "a y with y^T M y = 0 moves the state"};
  if (!vanishes(SparseMatrix(N.transpose()), null_space))
    return {std::nullopt, "N x leaves the range of M + M^T", true};
  MonotoneRange range{eigen.eigenvectors().rightCols(n - null), {}};
  range.unscaled = range.basis * values.tail(n - null).cwiseSqrt().cwiseInverse().asDiagonal();
  return {std::move(range), ""};
}

RangeOfM range_of_M(const DiscreteProblem& p) {
  if (!selects_least_norm(p.lcp_class) || p.modes()) return {};
  return range_of_M(p.scene.M, p.lcp_class, p.scene.dynamics->inputs(), p.scene.dynamics->outputs());
}

}  // namespace bromwich
