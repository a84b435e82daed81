#include "core/lcp/other_solutions.hpp"

#include "core/lcp/solution.hpp"

#include <Eigen/LU>

#include <cmath>

namespace bromwich {

namespace {

constexpr double least_other = 1e-10;
constexpr double distinct = 1e-6;

bool solves(const Matrix& M, const Vector& q, const Vector& y) {
  const Vector w = M * y + q, terms = M.cwiseAbs() * y.cwiseAbs() + q.cwiseAbs();
  const double size = y.cwiseAbs().maxCoeff();
  for (Index i = 0; i < y.size(); ++i) {
    const double zero_w = least_other * std::max(terms[i], 1e-300);
    if (y[i] < -least_other * size || w[i] < -zero_w) return false;
    if (y[i] > least_other * size && w[i] > zero_w) return false;
  }
  return true;
}

// y moves along a null vector of M_SS, S the rows with w = 0, until a component of y or w vanishes.
std::optional<Vector> along_a_null_vector(const Matrix& M, const Vector& q, const Vector& y) {
  const Index n = y.size();
  const double size = std::max(y.cwiseAbs().maxCoeff(), 1e-300);
  std::vector<Index> S;
  for (Index i = 0; i < n; ++i)
    if (y[i] > least_other * size) S.push_back(i);
  if (S.empty()) return std::nullopt;
  const Matrix block = M(S, S);
  Eigen::FullPivLU<Matrix> lu(block);
  lu.setThreshold(1e-11);
  if (lu.isInvertible()) return std::nullopt;
  const Matrix kernel = lu.kernel();
  for (Index c = 0; c < kernel.cols(); ++c)
    for (const double sign : {1.0, -1.0}) {
      Vector direction = Vector::Zero(n);
      direction(S) = sign * kernel.col(c).normalized();
      const Vector other = y + 0.5 * y(S).minCoeff() * direction;
      if (solves(M, q, other)) return other;
    }
  return std::nullopt;
}

}  // namespace

std::optional<Vector> another_solution(const Matrix& M, const Vector& q, const Vector& y) {
  const Index n = q.size();
  if (n > largest_searched || !q.allFinite() || !y.allFinite()) return std::nullopt;
  std::optional<Vector> nearest;
  const auto consider = [&](const Vector& other) {
    const double size = std::max(other.cwiseAbs().maxCoeff(), y.cwiseAbs().maxCoeff());
    const double apart = (other - y).cwiseAbs().maxCoeff();
    if (!(apart > distinct * size)) return;
    if (!nearest || apart < (*nearest - y).cwiseAbs().maxCoeff()) nearest = other;
  };
  for (unsigned set = 0; set < 1u << n; ++set) {
    const std::vector<Index> S = members(set, n);
    Vector other = Vector::Zero(n);
    if (!S.empty()) {
      const Eigen::PartialPivLU<Matrix> lu(M(S, S));
      if (!(lu.rcond() > 1e-12)) continue;
      other(S) = -Vector(lu.solve(Vector(q(S))));
    }
    if (solves(M, q, other)) consider(other);
  }
  if (const auto moved = along_a_null_vector(M, q, y)) consider(*moved);
  return nearest;
}

}  // namespace bromwich
