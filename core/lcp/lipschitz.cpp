#include "core/lcp/lipschitz.hpp"

#include "core/lcp/comparison.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/lcp/solution.hpp"
#include "core/numerics/equilibration.hpp"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace bromwich {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// ||M_SS^{-1}||_inf; infinite if M_SS is singular to rounding. It is scaled, so that small rows do not count as
// dependent.
double inverse_norm(const Matrix& M) {
  const auto inverse = scaled_inverse(M, 16 * double(M.rows()) * epsilon);
  return inverse ? inverse->cwiseAbs().rowwise().sum().maxCoeff() : infinity;
}

double largest_inverse_norm(const Matrix& M) {
  double L = 0;
  for (unsigned set = 1; set < 1u << M.rows() && L < infinity; ++set) {
    const std::vector<Index> S = members(set, M.rows());
    L = std::max(L, inverse_norm(M(S, S)));
  }
  return L;
}

// The smallest eigenvalue of (M + M^T)/2 minus its rounding error.
double smallest_eigenvalue(const LcpMatrix& M) {
  Eigen::SelfAdjointEigenSolver<Matrix> eigen;
  if (const auto* t = std::get_if<Tridiagonal>(&M)) {
    const Index n = t->diagonal.size();
    eigen.computeFromTridiagonal(t->diagonal, (t->lower.tail(n - 1) + t->upper.head(n - 1)) / 2,
                                 Eigen::EigenvaluesOnly);
  } else {
    const Matrix dense = to_dense(M);
    eigen.compute(Matrix((dense + dense.transpose()) / 2), Eigen::EigenvaluesOnly);
  }
  const Vector& values = eigen.eigenvalues();
  return values[0] - double(values.size()) * epsilon * values.cwiseAbs().maxCoeff();
}

}  // namespace

double solution_lipschitz(const LcpMatrix& M) {
  const Index n = size(M);
  if (n <= 12) return largest_inverse_norm(to_dense(M));
  double bound = infinity;
  if (is_H_plus(M)) bound = Comparison(M).solve(Vector::Ones(n)).maxCoeff();
  if (n > 2048 && sparse_of(M)) return bound;      // a dense eigenvalue problem is too large
  if (n > 2048 && bound < infinity) return bound;  // O(n) for a tridiagonal matrix
  const double lambda = smallest_eigenvalue(M);
  if (lambda > 0) bound = std::min(bound, std::sqrt(double(n)) / lambda);
  return bound;
}

std::optional<Matrix> inverse_comparison(const LcpMatrix& M) {
  const Index n = size(M);
  if (n > 2048 || !is_H_plus(M)) return std::nullopt;
  const Comparison C(M);
  Matrix inverse(n, n);
  for (Index j = 0; j < n; ++j) inverse.col(j) = C.solve(Vector::Unit(n, j)).cwiseMax(0);
  return inverse;
}

}  // namespace bromwich
