#include "core/lcp/least_norm.hpp"

#include "core/lcp/enumeration.hpp"
#include "core/lcp/lemke.hpp"
#include "core/lcp/solution.hpp"

#include <Eigen/LU>
#include <Eigen/QR>

#include <cmath>

namespace bromwich {

namespace {

constexpr double rank_rounding = 1e-11;  ///< below this a pivot of M_SS counts as zero, relative to the largest

// The x of least norm with A x = b for a consistent system. Scaling of rows does not change it; scaling of columns does
// not if A has full rank.
Vector least_norm_solve(const Matrix& A, const Vector& b) {
  const Equilibration e = equilibrate(A);
  const Eigen::PartialPivLU<Matrix> lu(scaled(A, e));
  if (reciprocal_condition(lu) > rank_rounding) return e.columns.cwiseProduct(lu.solve(e.rows.cwiseProduct(b)));
  Vector rows = A.rowwise().norm();
  rows = (rows.array() > 0).select(rows.cwiseInverse(), Vector::Ones(rows.size()));
  Eigen::CompleteOrthogonalDecomposition<Matrix> decomposition;
  decomposition.setThreshold(rank_rounding);
  decomposition.compute(rows.asDiagonal() * A);
  return decomposition.solve(Vector(rows.cwiseProduct(b)));
}

class Monotone {
 public:
  Monotone(const Matrix& M, const Vector& q) : M_(M), q_(q), n_(q.size()), e_(equilibrate(M)), scaled_(scaled(M, e_)) {
    scaled_q_ = e_.rows.cwiseProduct(q);
  }

  bool solves(const Vector& y) const { return is_solution(scaled_, scaled_q_, y.cwiseQuotient(e_.columns)); }

  /// The limit of the Tikhonov solutions if S is their active set.
  Vector limit(const std::vector<Index>& S) const {
    Vector y = Vector::Zero(n_);
    if (S.empty()) return y;
    const Vector limit = least_norm_solve(M_(S, S), -q_(S));
    // Values that are zero in exact arithmetic are of the size of rounding times the condition of M_SS. If omitting one
    // changes the residual, it was not zero.
    y(S) = (limit.array() > 1e-12 * limit.cwiseAbs().maxCoeff()).select(limit, 0);
    if (!solves(y)) y(S) = limit.cwiseMax(0);
    return y;
  }

  /// Whether the solution y = limit(S) is the one of least norm.
  bool is_least(const Vector& y, const std::vector<Index>& S) const {
    if (S.empty()) return true;
    Vector slope = Vector::Zero(n_);
    slope(S) = least_norm_solve(M_(S, S), -y(S));
    const Vector rise = M_ * slope + y, terms = M_.cwiseAbs() * slope.cwiseAbs() + y;
    const Vector w = M_ * y + q_, w_terms = M_.cwiseAbs() * y + q_.cwiseAbs();
    const double level = 1e-9 * slope.cwiseAbs().maxCoeff();
    std::vector<char> in_S(std::size_t(n_), 0);
    for (const Index i : S) in_S[std::size_t(i)] = 1;
    for (Index i = 0; i < n_; ++i) {
      if (in_S[std::size_t(i)] && y[i] == 0 && slope[i] < -level) return false;
      const bool zero = in_S[std::size_t(i)] || std::abs(w[i]) <= 1e-12 * w_terms[i];
      if (zero && rise[i] < -1e-9 * terms[i]) return false;
      if (in_S[std::size_t(i)] && rise[i] > 1e-9 * terms[i]) return false;
    }
    return true;
  }

  /// Whether v >= 0 proves that there is no feasible point.
  bool proves_infeasible(Vector v) const {
    v = v.cwiseMax(0).cwiseQuotient(e_.rows);
    if (!v.allFinite() || !(v.maxCoeff() > 0)) return false;
    v /= v.maxCoeff();
    const double rounding = 16 * double(n_ + 4) * epsilon;
    const Vector column = scaled_.transpose() * v, terms = scaled_.cwiseAbs().transpose() * v;
    return (column.array() <= rounding * terms.array()).all() &&
           scaled_q_.dot(v) < -rounding * scaled_q_.cwiseAbs().maxCoeff() * v.sum();
  }

  /// The part of -q_S outside the range of M_SS.
  Vector out_of_reach(const std::vector<Index>& S) const {
    Vector v = Vector::Zero(n_);
    if (S.empty()) return v;
    const Matrix block = M_(S, S);
    Eigen::CompleteOrthogonalDecomposition<Matrix> decomposition;
    decomposition.setThreshold(rank_rounding);
    decomposition.compute(block);
    const Vector rest = -q_(S) - block * Vector(decomposition.solve(Vector(-q_(S))));
    v(S) = (rest.array() > 1e-12 * rest.cwiseAbs().maxCoeff()).select(rest, 0);
    return v;
  }

  bool lemke_proves_infeasible(int& problems) const {
    const LemkeOutcome outcome = lemke(scaled_, scaled_q_);
    problems += outcome.pivots;
    return outcome.ray && proves_infeasible(e_.columns.cwiseProduct(outcome.direction));
  }

 private:
  const Matrix& M_;
  const Vector& q_;
  Index n_;
  Equilibration e_;
  Matrix scaled_;  ///< R M C
  Vector scaled_q_;
};

// The solution of least norm is one of the limits on all active sets.
void enumerate(const Monotone& problem, Index n, LeastNorm& best) {
  for (unsigned set = 0; set < 1u << n; ++set) {
    const Vector y = problem.limit(members(set, n));
    if (!problem.solves(y) || (best.solved && y.norm() >= best.y.norm())) continue;
    best.solved = true;
    best.y = y;
  }
}

}  // namespace

LeastNorm least_norm_solution(const Matrix& M, const Vector& q, const DefiniteSolver& solve_definite) {
  const Index n = q.size();
  LeastNorm found;
  found.y = Vector::Zero(n);
  if (!q.allFinite()) return found;
  if (n == 0 || q.minCoeff() >= 0) {
    found.solved = true;
    return found;
  }
  const Monotone problem(M, q);
  const double size = M.cwiseAbs().maxCoeff();
  for (double eps = 1e-3 * size; eps > 1e-13 * size; eps *= 1e-2) {
    Vector near;
    const auto [solved, sets] = solve_definite(M + eps * Matrix::Identity(n, n), q, near);
    found.problems += sets;
    if (!solved) continue;
    const std::vector<Index> S = support_of(near);
    const Vector y = problem.limit(S);
    if (!problem.solves(y)) {
      found.infeasible = problem.proves_infeasible(problem.out_of_reach(S));
      if (found.infeasible) return found;
      continue;
    }
    const bool least = problem.is_least(y, S);
    if (least || !found.solved || y.norm() < found.y.norm()) found.y = y;
    found.solved = true;
    if (least) return found;
  }
  if (!found.solved) found.infeasible = problem.lemke_proves_infeasible(found.problems);
  if (!found.infeasible && n <= largest_enumeration) enumerate(problem, n, found);
  return found;
}

}  // namespace bromwich
