#include "core/lcp/enumeration.hpp"

#include "core/lcp/solution.hpp"

#include <Eigen/LU>
#include <Eigen/QR>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

// A solution with active set S, if there is one: q is in the cone of the columns -M_S and e_i, i not in S.
Vector in_complementary_cone(const Matrix& M, const Vector& q, const std::vector<Index>& S) {
  const Index n = q.size();
  Matrix A = Matrix::Identity(n, n);
  for (const Index s : S) A.col(s) = -M.col(s);
  // Farther from q than is_solution allows, a point of the span is no solution, nor is one of the cone.
  constexpr double farthest = 1e-4;
  const double distance = (A * Eigen::ColPivHouseholderQR<Matrix>(A).solve(q) - q).norm();
  if (distance > farthest * std::sqrt(double(n)) * q.cwiseAbs().maxCoeff()) return Vector::Zero(n);
  const Vector x = nonnegative_least_squares(A, q);
  Vector y = Vector::Zero(n);
  y(S) = x(S);
  return y;
}

}  // namespace

Vector nonnegative_least_squares(const Matrix& A, const Vector& b) {
  const Index n = A.cols();
  Vector x = Vector::Zero(n);
  std::vector<Index> P;  // columns in use
  const double level = 64 * double(n) * epsilon * (b.norm() > 0 ? b.norm() : 1);
  for (Index round = 0; round < 4 * n; ++round) {
    Vector gradient = A.transpose() * (b - A * x);
    for (const Index j : P) gradient[j] = 0;
    Index enters;
    if (n == 0 || !(gradient.maxCoeff(&enters) > level * A.col(enters).norm())) return x;
    P.push_back(enters);
    for (;;) {
      const Vector z = Eigen::ColPivHouseholderQR<Matrix>(A(Eigen::all, P)).solve(b);
      if (z.minCoeff() > 0) {
        x.setZero();
        x(P) = z;
        break;
      }
      double step = 1;  // the longest step from x towards z with a result >= 0
      for (std::size_t k = 0; k < P.size(); ++k)
        if (z[Index(k)] <= 0) step = std::min(step, x[P[k]] / (x[P[k]] - z[Index(k)]));
      for (std::size_t k = 0; k < P.size(); ++k) x[P[k]] += step * (z[Index(k)] - x[P[k]]);
      for (std::size_t k = 0; k < P.size(); ++k)
        if (z[Index(k)] <= 0 && x[P[k]] <= epsilon * x.maxCoeff()) x[P[k]] = 0;
      const std::size_t before = P.size();
      std::erase_if(P, [&x](Index j) { return !(x[j] > 0); });
      if (P.empty() || P.size() == before) return x;
    }
  }
  return x;
}

std::optional<Vector> solve_by_enumeration(const Matrix& M, const Vector& q,
                                           const std::function<bool(const std::vector<Index>&)>& admissible) {
  const Index n = q.size();
  for (unsigned set = 0; set < 1u << n; ++set) {
    const std::vector<Index> S = members(set, n);
    if (!admissible(S)) continue;
    Vector y = Vector::Zero(n);
    if (!S.empty()) {
      const Eigen::PartialPivLU<Matrix> lu(M(S, S));
      if (reciprocal_condition(lu) > 1e-13)
        y(S) = Vector(lu.solve(-q(S))).cwiseMax(0);
      else
        y = in_complementary_cone(M, q, S);
    }
    if (is_solution(M, q, y)) return y;
  }
  return std::nullopt;
}

}  // namespace bromwich
