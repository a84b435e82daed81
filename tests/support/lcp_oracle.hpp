#pragma once
// Least-norm solutions of monotone complementarity problems by enumeration of the active inequalities, and random
// problems whose solution or infeasibility is known by construction.

#include "tests/support/reference.hpp"

#include <Eigen/Dense>

#include <optional>
#include <vector>

namespace bromwich::oracle {

/// min ||y|| over the solutions of LCP(q, M), M PSD, n <= 6, given one solution y*. The solution set is y >= 0,
/// M y + q >= 0, (M + M^T)(y - y*) = 0, q^T (y - y*) = 0 (Cottle, Pang, Stone, theorem 3.1.7). The minimiser is the
/// least-norm point of the affine set defined by its active inequalities.
inline Vector least_norm(const Matrix& M, const Vector& q, const Vector& known) {
  const Index n = q.size();
  Matrix equal(n + 1, n), bounds(2 * n, n);
  equal << M + M.transpose(), q.transpose();
  bounds << Matrix::Identity(n, n), M;
  Vector least(2 * n);  // bounds y >= least
  least << Vector::Zero(n), -q;
  std::optional<Vector> best;
  for (unsigned set = 0; set < 1u << 2 * n; ++set) {
    std::vector<Index> active;
    for (Index i = 0; i < 2 * n; ++i)
      if (set >> i & 1u) active.push_back(i);
    Matrix A(n + 1 + Index(active.size()), n);
    Vector b(A.rows());
    A << equal, bounds(active, Eigen::all);
    b << equal * known, least(active);
    Eigen::CompleteOrthogonalDecomposition<Matrix> decomposition;
    decomposition.setThreshold(1e-10);
    const Vector y = decomposition.compute(A).solve(b);
    // Entries of size 1; a singular value near 1e-3 costs three of sixteen digits.
    if ((A * y - b).cwiseAbs().maxCoeff() > 1e-10 || (bounds * y - least).minCoeff() < -1e-10) continue;
    if (!best || y.norm() < best->norm()) best = y;
  }
  return *best;
}

struct Monotone {
  Matrix M;
  Vector q, known;  ///< one solution
};

/// A singular PSD matrix with small integer factors, so that ranks are clear: L L^T plus, by `kind`, nothing or a skew
/// part; only a skew part; or every row and column twice. The known solution is sometimes degenerate.
inline Monotone random_monotone(reference::Random& random, Index n, int kind) {
  const auto integers = [&random](Index rows, Index cols) {
    return Matrix(Matrix::NullaryExpr(rows, cols, [&random] { return std::round(random.uniform(-2.4, 2.4)); }));
  };
  const Index half = kind == 3 ? (n + 1) / 2 : n;
  const Matrix L = integers(half, std::max<Index>(1, half - 1)), K = integers(half, half);
  Matrix M = Matrix::Zero(half, half);
  if (kind != 2) M += L * L.transpose();
  if (kind == 1 || kind == 2) M += K - K.transpose();
  if (kind == 3) M = Matrix(M.replicate(2, 2)).topLeftCorner(n, n);
  Monotone p{M, Vector(n), Vector::Zero(n)};
  for (Index i = 0; i < n; ++i) {
    const double choice = random.uniform(0, 5);
    if (choice < 2) p.known[i] = random.uniform(0.1, 1);
    p.q[i] = choice > 3 ? random.uniform(0.1, 1) : 0;  // w of the known solution
  }
  p.q -= M * p.known;
  return p;
}

/// M PSD and q with v >= 0, M^T v = 0, q^T v = -1: no feasible point.
inline Monotone random_infeasible(reference::Random& random, Index n) {
  Vector v = (random.vector(n).array() + 0.5).cwiseMax(0);
  v[0] = 1;
  const Matrix project = Matrix::Identity(n, n) - v * v.transpose() / v.squaredNorm();
  const Matrix L = project * random.matrix(n, n), K = project * random.matrix(n, n) * project;
  Monotone p{L * L.transpose() + K - K.transpose(), random.vector(n), {}};
  p.q -= (p.q.dot(v) + 1) / v.squaredNorm() * v;
  return p;
}

}  // namespace bromwich::oracle
