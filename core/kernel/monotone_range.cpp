#include "core/kernel/monotone_range.hpp"

#include "core/lcp/active_set.hpp"
#include "core/numerics/equilibration.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index largest = 1024;
constexpr Index largest_L = 12;          ///< active sets are enumerated up to this size
constexpr double most_projected = 4e6;   ///< entries of U0^T N
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

// Whether LCP(M, N x + q) has a solution for all x where LCP(M, q) has one: N U0's part is in the cone of these q,
// which is convex and contains the range of S.
bool stays_feasible(const Matrix& M, LcpClass lcp_class, const SparseMatrix& N, const Matrix& null_space) {
  if (double(null_space.cols()) * double(N.cols()) > most_projected) return false;
  const Matrix seen = null_space.transpose() * N;
  Eigen::ColPivHouseholderQR<Matrix> qr;
  qr.setThreshold(rank_rounding);
  qr.compute(seen);
  const Matrix directions = null_space * Matrix(qr.householderQ()).leftCols(qr.rank());
  ActiveSetLcp lcp(M, lcp_class);
  Vector y;
  for (Index k = 0; k < directions.cols(); ++k)
    for (const double sign : {1.0, -1.0})
      if (!lcp.solve(sign * directions.col(k), y).solved) return false;
  return true;
}

// L of case 2.
double lipschitz_on_range(const Matrix& M, const Matrix& root, const Vector& scale) {
  const Index n = M.rows();
  if (n > largest_L) return INFINITY;
  double L = 0;
  for (unsigned set = 1; set < 1u << n; ++set) {
    const std::vector<Index> S = members(set, n);
    const auto inverse = scaled_inverse(M(S, S), rank_rounding);
    if (!inverse) continue;
    const Matrix piece = root(Eigen::all, S) * *inverse * scale(S).asDiagonal();
    L = std::max(L, std::sqrt(std::max(largest_eigenvalue(piece.transpose() * piece), 0.0)));
  }
  return L;
}

}  // namespace

double MonotoneRange::contraction(const Matrix& W) const {
  if (unscaled.cols() == 0) return 0;
  const Matrix images = W * unscaled;
  const Matrix inside =
      holds_outputs ? Matrix(unscaled.transpose() * images) : Matrix(inverse_scale.asDiagonal() * images);
  const Matrix square = inside.transpose() * inside;
  return lipschitz * std::sqrt(std::max(largest_eigenvalue(square), 0.0));
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
  MonotoneRange range{eigen.eigenvectors().rightCols(n - null), {}};
  const Vector roots = values.tail(n - null).cwiseSqrt();
  range.unscaled = range.basis * roots.cwiseInverse().asDiagonal();
  range.holds_outputs = vanishes(SparseMatrix(N.transpose()), null_space);
  if (range.holds_outputs) return {std::move(range), ""};
  if (!stays_feasible(dense, lcp_class, N, null_space)) return {std::nullopt, "N x leaves the range of M + M^T", true};
  const Vector own = dense.diagonal(), scale = (own.array() > 0).select(own.array().sqrt(), 1);
  range.inverse_scale = scale.cwiseInverse();
  range.lipschitz = lipschitz_on_range(dense, range.basis * roots.asDiagonal() * range.basis.transpose(), scale);
  return {std::move(range), ""};
}

RangeOfM range_of_M(const DiscreteProblem& p) {
  if (!selects_least_norm(p.lcp_class) || p.modes()) return {};
  return range_of_M(p.scene.M, p.lcp_class, p.scene.dynamics->inputs(), p.scene.dynamics->outputs());
}

}  // namespace bromwich
