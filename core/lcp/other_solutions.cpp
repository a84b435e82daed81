#include "core/lcp/other_solutions.hpp"

#include "core/lcp/solution.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double least_other = 1e-10;
constexpr double distinct = 1e-6;

bool solves(const Matrix& M, const Vector& q, const Vector& y) {
  const double size = y.cwiseAbs().maxCoeff();
  if (y.minCoeff() < -least_other * size) return false;
  const Vector w = M * y + q, terms = M.cwiseAbs() * y.cwiseAbs() + q.cwiseAbs();
  for (Index i = 0; i < y.size(); ++i) {
    const double zero_w = least_other * std::max(terms[i], 1e-300);
    if (w[i] < -zero_w) return false;
    if (y[i] > least_other * size && w[i] > zero_w) return false;
  }
  return true;
}

// From y along d: half the way on which no component becomes negative.
Vector half_way(const Vector& y, const Vector& d) {
  double most = INFINITY;
  for (Index i = 0; i < y.size(); ++i)
    if (d[i] < 0) most = std::min(most, -y[i] / d[i]);
  return y + 0.5 * (std::isfinite(most) ? most : std::max(y.maxCoeff(), 1.0) / d.maxCoeff()) * d;
}

// y moves along null vectors of M_SS, S the support of y, and at corners of S with one more row whose y_i and w_i are
// zero.
std::optional<Vector> along_a_null_vector(const Matrix& M, const Vector& q, const Vector& y, bool at_corners) {
  const Index n = y.size();
  const double size = std::max(y.cwiseAbs().maxCoeff(), 1e-300);
  const Vector w = M * y + q, terms = M.cwiseAbs() * y.cwiseAbs() + q.cwiseAbs();
  std::vector<Index> support, more{-1};
  for (Index i = 0; i < n; ++i)
    if (y[i] > least_other * size)
      support.push_back(i);
    else if (at_corners && w[i] <= least_other * terms[i])
      more.push_back(i);
  for (const Index added : more) {
    std::vector<Index> S = support;
    if (added >= 0) S.push_back(added);
    if (S.empty()) continue;
    Eigen::FullPivLU<Matrix> lu(Matrix(M(S, S)));
    lu.setThreshold(1e-11);
    if (lu.isInvertible()) continue;
    const Matrix kernel = lu.kernel();
    for (Index c = 0; c < kernel.cols(); ++c)
      for (const double sign : {1.0, -1.0}) {
        Vector direction = Vector::Zero(n);
        direction(S) = sign * kernel.col(c).normalized();
        if (added >= 0 && !(direction[added] > 0)) continue;
        const Vector other = half_way(y, direction);
        if (solves(M, q, other)) return other;
      }
  }
  return std::nullopt;
}

}  // namespace

SolutionsBeside::SolutionsBeside(const Matrix& M) : M_(M) {
  const Index n = M.rows();
  for (unsigned set = 1; n <= largest_searched && set < 1u << n; ++set) {
    const std::vector<Index> S = members(set, n);
    Eigen::PartialPivLU<Matrix> lu(M(S, S));
    if (lu.rcond() > 1e-12) sets_.push_back({S, std::move(lu)});
  }
}

std::optional<Vector> SolutionsBeside::nearest(const Vector& q, const Vector& y, bool at_corners) const {
  if (!q.allFinite() || !y.allFinite()) return std::nullopt;
  std::optional<Vector> nearest;
  const auto consider = [&](const Vector& other) {
    const double size = std::max(other.cwiseAbs().maxCoeff(), y.cwiseAbs().maxCoeff());
    const double apart = (other - y).cwiseAbs().maxCoeff();
    if (!(apart > distinct * size)) return;
    if (!nearest || apart < (*nearest - y).cwiseAbs().maxCoeff()) nearest = other;
  };
  Vector other = Vector::Zero(q.size());
  if (q.size() <= largest_searched && solves(M_, q, other)) consider(other);
  for (const RegularSet& set : sets_) {
    other.setZero();
    other(set.active) = -Vector(set.lu.solve(Vector(q(set.active))));
    if (solves(M_, q, other)) consider(other);
  }
  if (const auto moved = along_a_null_vector(M_, q, y, at_corners)) consider(*moved);
  return nearest;
}

std::optional<Vector> another_solution(const Matrix& M, const Vector& q, const Vector& y, bool at_corners) {
  return SolutionsBeside(M).nearest(q, y, at_corners);
}

}  // namespace bromwich
