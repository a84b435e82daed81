#include "core/lcp/sparse_lcp.hpp"

#include "core/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <set>

namespace bromwich {

namespace {

constexpr int most_sets = 100;
constexpr double solved_to = 1e-12;  ///< relative_natural_residual of an accepted solution: cancellation in w

bool is_symmetric(const SparseMatrix& M) {
  const SparseMatrix transposed = M.transpose();
  return (M - transposed).norm() == 0;
}

// Spectral radius of J = |D^{-1}(M - D)| from above: max_i (J u)_i / u_i for any u > 0 (Collatz and Wielandt), for the
// iterates of the power method on (I + J)/2, which converge for every irreducible J.
double jacobi_radius(const SparseMatrix& M) {
  const Vector diagonal = M.diagonal();
  SparseMatrix J = M.cwiseAbs();
  J = diagonal.cwiseInverse().asDiagonal() * J;
  Vector u = Vector::Ones(M.rows());
  double radius = INFINITY;
  for (int i = 0; i < 200; ++i) {
    const Vector next = J * u;  // (I + J) u
    radius = std::min(radius, (next.array() / u.array()).maxCoeff() - 1);
    u = next / next.maxCoeff();
    u = u.cwiseMax(1e-12);
  }
  return radius;
}

}  // namespace

SweepPlan plan_sweeps(const SparseMatrix& M) {
  SweepPlan plan;
  const Vector diagonal = M.diagonal();
  for (Index i = 0; i < diagonal.size(); ++i)
    if (!(diagonal[i] > 0)) {
      plan.why = text("its diagonal entry %td is %.3g", i, diagonal[i]);
      return plan;
    }
  const LcpMatrix given = SparseLcpMatrix(M);
  plan.radius = M.rows() > 0 ? std::clamp(jacobi_radius(M), 0.0, 10.0) : 0;
  const double optimal = plan.radius < 1 ? 2 / (1 + std::sqrt(1 - plan.radius * plan.radius)) : 1.9;
  if (is_symmetric(M) && is_surely_P(given)) {
    // For a symmetric M, H+ with a positive diagonal is positive definite.
    plan.converges = true;
    plan.omega = std::min(optimal, 1.97);
    plan.why = "symmetric positive definite";
  } else if (is_H_plus(given)) {
    plan.converges = true;
    plan.omega = plan.radius < 1 ? std::min(optimal, 0.98 * 2 / (1 + plan.radius)) : 0.98;
    plan.why = "H+";
  } else {
    plan.why = "it is neither symmetric positive definite nor H+ (a comparison matrix that is an M-matrix)";
  }
  return plan;
}

double relative_natural_residual(const SparseMatrix& M, const Vector& q, const Vector& y) {
  if (q.size() == 0) return 0;
  const Vector w = M * y + q, size = q.cwiseAbs() + M.cwiseAbs() * y.cwiseAbs();
  const double scale = std::max(size.maxCoeff(), 1e-300);
  const double worst = y.cwiseMin(w).cwiseAbs().maxCoeff();
  return std::isfinite(w.sum()) ? worst / scale : INFINITY;
}

LcpOutcome SparseActiveSet::solve(const Vector& q, Vector& y) {
  LcpOutcome outcome;
  const Index n = q.size();
  std::set<std::vector<bool>> seen;
  std::vector<bool> active(static_cast<std::size_t>(n));
  for (Index i = 0; i < n; ++i) active[std::size_t(i)] = y[i] > 0;
  while (outcome.newton < most_sets && seen.insert(active).second) {
    ++outcome.newton;
    std::vector<Index> S;
    std::vector<int> place(std::size_t(n), -1);
    for (Index i = 0; i < n; ++i)
      if (active[std::size_t(i)]) place[std::size_t(i)] = int(S.size()), S.push_back(i);
    y.setZero();
    if (!S.empty()) {
      std::vector<Eigen::Triplet<double>> entries;
      for (std::size_t c = 0; c < S.size(); ++c)
        for (SparseMatrix::InnerIterator a(M_, S[c]); a; ++a)
          if (const int r = place[std::size_t(a.row())]; r >= 0) entries.emplace_back(r, int(c), a.value());
      SparseMatrix block{Index(S.size()), Index(S.size())};
      block.setFromTriplets(entries.begin(), entries.end());
      Eigen::SparseLU<SparseMatrix> lu(block);
      if (lu.info() != Eigen::Success) return outcome;
      const Vector found = lu.solve(Vector(-q(S)));
      if (lu.info() != Eigen::Success || !found.allFinite()) return outcome;
      y(S) = found;
    }
    const Vector w = M_ * y + q;
    for (Index i = 0; i < n; ++i) active[std::size_t(i)] = active[std::size_t(i)] ? y[i] > 0 : w[i] < 0;
    const Vector positive = y.cwiseMax(0);
    if (relative_natural_residual(M_, q, positive) <= solved_to) {
      y = positive;
      outcome.solved = true;
      return outcome;
    }
  }
  return outcome;
}

}  // namespace bromwich
