// The oracle's steps: complementarity problems in any units, Radau IIA and implicit Euler on the state.

#include "tests/support/oracle.hpp"

#include <Eigen/Dense>
#include <unsupported/Eigen/KroneckerProduct>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace bromwich::oracle {
namespace {

/// Allowed residual of a solution relative to the terms of a row: a solve of size <= 12 with M_SS of condition up to
/// 1e5.
constexpr double solved = 1e-11;
/// A pivot below this counts as zero, relative to the largest entry after equilibration.
constexpr double rank = 1e-12;

/// R M C, equilibrated: independent of units.
struct Scaled {
  Scaled(const Matrix& M, const Vector& given) : matrix(M), rows(Vector::Ones(M.rows())), columns(rows) {
    const auto root = [](double largest) { return largest > 0 ? 1 / std::sqrt(largest) : 1.0; };
    for (int sweep = 0; sweep < 6; ++sweep)
      for (Index i = 0; i < M.rows(); ++i) {
        const double r = root(matrix.row(i).cwiseAbs().maxCoeff());
        matrix.row(i) *= r;
        rows[i] *= r;
        const double c = root(matrix.col(i).cwiseAbs().maxCoeff());
        matrix.col(i) *= c;
        columns[i] *= c;
      }
    q = rows.cwiseProduct(given);
  }

  /// z = C^{-1} y with active set S, clipped to z >= 0, if that solves the problem. `accept`: also with a singular
  /// M_SS.
  std::optional<Vector> on(const std::vector<Index>& S, bool accept) const {
    Vector z = Vector::Zero(q.size());
    if (!S.empty()) {
      Eigen::FullPivLU<Matrix> lu(matrix(S, S));
      lu.setThreshold(rank);
      if (lu.isInvertible()) {
        z(S) = Vector(lu.solve(Vector(-q(S))));
      } else {
        if (!accept) return std::nullopt;
        // Least norm in the units of y.
        const Matrix block = matrix(S, S) * columns(S).cwiseInverse().asDiagonal();
        Eigen::CompleteOrthogonalDecomposition<Matrix> least;
        least.setThreshold(rank);
        least.compute(block);
        z(S) = columns(S).cwiseInverse().cwiseProduct(Vector(least.solve(Vector(-q(S)))));
      }
    }
    const double level = solved * std::max(z.cwiseAbs().maxCoeff(), q.cwiseAbs().maxCoeff());
    if (!z.allFinite() || (z.array() < -level).any()) return std::nullopt;
    z = z.cwiseMax(0);
    const Vector w = matrix * z + q, terms = matrix.cwiseAbs() * z + q.cwiseAbs();
    const double least = solved * (q.cwiseAbs().maxCoeff() + terms.maxCoeff());
    for (Index i = 0; i < z.size(); ++i)
      if (w[i] < -least || std::min(z[i], w[i]) > least) return std::nullopt;
    return z;
  }

  Matrix matrix;
  Vector rows, columns, q;
};

bool is_psd(const Matrix& M) {
  const Matrix symmetric = M + M.transpose();
  if (symmetric.isZero(0)) return true;
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(symmetric, Eigen::EigenvaluesOnly);
  return eigen.eigenvalues().minCoeff() > -1e-13 * double(M.rows()) * eigen.eigenvalues().cwiseAbs().maxCoeff();
}

bool minors_positive(const Matrix& M) {
  const Index n = M.rows() - 1;
  if (n < 0) return true;
  if (!(M(0, 0) > 1e-11)) return false;
  const Matrix rest = M.bottomRightCorner(n, n);
  return minors_positive(rest) && minors_positive(rest - M.col(0).tail(n) * M.row(0).tail(n) / M(0, 0));
}

/// Radau IIA with two stages.
const Matrix radau{{5. / 12, -1. / 12}, {3. / 4, 1. / 4}};
const Vector radau_nodes{{1. / 3, 1}};

}  // namespace

bool is_p_matrix(const Matrix& M) { return minors_positive(Scaled(M, Vector::Zero(M.rows())).matrix); }

LcpClass class_of(const Matrix& M) {
  if (is_p_matrix(M)) return LcpClass::P;
  if (is_psd(M)) return LcpClass::PSD;
  Matrix off = M;
  off.diagonal().setZero();
  return off.maxCoeff() <= 0 && M.diagonal().minCoeff() > 0 ? LcpClass::Z : LcpClass::unknown;
}

std::vector<Vector> solutions(const Matrix& M, const Vector& q) {
  const Scaled problem(M, q);
  std::vector<Vector> all;
  for (unsigned set = 0; set < 1u << q.size(); ++set)
    if (const auto z = problem.on(members(set, q.size()), true)) all.push_back(problem.columns.cwiseProduct(*z));
  return all;
}

std::optional<Vector> selected_solution(const Matrix& M, const Vector& q, LcpClass lcp_class) {
  std::optional<Vector> best;
  for (const Vector& y : solutions(M, q)) {
    if (!best)
      best = y;
    else if (lcp_class == LcpClass::Z)
      best = best->cwiseMin(y);
    else if (lcp_class == LcpClass::PSD && y.norm() < best->norm())
      best = y;
  }
  return best;
}

std::optional<Vector> some_solution(const Matrix& M, const Vector& q, const Vector& near) {
  const Index n = q.size();
  const Scaled problem(M, q);
  unsigned last = 0;
  for (Index i = 0; i < n; ++i) last |= near[i] > 0 ? 1u << i : 0u;
  for (int distance = 0; distance <= n; ++distance)
    for (unsigned flips = 0; flips < 1u << n; ++flips)
      if (std::popcount(flips) == distance)
        if (const auto z = problem.on(members(last ^ flips, n), n <= 6)) return problem.columns.cwiseProduct(*z);
  return std::nullopt;
}

Steps::Steps(const DenseScene& s, Scheme scheme, Index J) : s_(s), scheme_(scheme), h_(s.T / double(J)) {
  const Index m = s.A.rows();
  if (scheme == Scheme::exponential) {
    const Phi phi = phi_functions(h_ * s.A);
    decay_ = phi.exponential;
    left_ = h_ * (phi.phi1 - phi.phi2);
    right_ = h_ * phi.phi2;
    return;
  }
  const Matrix a = scheme == Scheme::radau ? radau : Matrix::Ones(1, 1);
  const Index stages = a.rows();
  const Matrix system = Matrix::Identity(stages * m, stages * m) - h_ * Matrix(Eigen::kroneckerProduct(a, s.A));
  const Eigen::FullPivLU<Matrix> lu(system);
  decay_ = lu.solve(Matrix(Eigen::kroneckerProduct(Matrix::Ones(stages, 1), Matrix::Identity(m, m))));
  right_ = lu.solve(h_ * Matrix(Eigen::kroneckerProduct(a, Matrix::Identity(m, m))));
}

StepProblem Steps::problem(Index j, const Vector& x, const Vector& y) const {
  const Index m = s_.A.rows(), n = s_.M.rows(), stages = right_.rows() / m;
  const double before = h_ * double(j - 1);
  Vector f(stages * m), g(stages * n);
  for (Index i = 0; i < stages; ++i) {
    const double t = stages == 2 && i == 0 ? before + radau_nodes[0] * h_ : h_ * double(j);
    f.segment(i * m, m) = value(s_.f, t, m);
    g.segment(i * n, n) = value(s_.g, t, n);
  }
  const Matrix each = Matrix::Identity(stages, stages);
  const Matrix N = Eigen::kroneckerProduct(each, s_.N), M = Eigen::kroneckerProduct(each, s_.M),
               RB = right_ * Matrix(Eigen::kroneckerProduct(each, s_.B));
  Vector X = decay_ * x + right_ * f;
  if (scheme_ == Scheme::exponential) X += left_ * (s_.B * y + value(s_.f, before, m));
  return {M + N * RB, RB.bottomRows(m), N * X + g, X.tail(m)};
}

bool jumps(const DenseScene& s, double h, const Vector& Y, const Vector& before, const Vector& after,
           const Vector& regular, double margin) {
  const Index n = s.M.rows();
  const Vector first = Y.head(n), last = Y.tail(n);
  if (((first.array() > 0) == (last.array() > 0)).all()) return false;
  const double zero = 1e-9 * margin * Y.cwiseAbs().maxCoeff();
  // Contacts that stay or begin end on the constraint, whatever the step.
  Vector released = Vector::Zero(n);
  for (Index i = 0; i < n; ++i) {
    if (!(first[i] > zero) || last[i] > zero / (margin * margin)) continue;
    if (first[i] > 4 * margin * regular[i]) return true;
    released[i] = first[i];
  }
  const Vector moved = h / margin * (s.B * released).cwiseAbs();
  const Vector size = before.cwiseAbs().cwiseMax(after.cwiseAbs());
  const double least = 0.01 * size.maxCoeff();
  for (Index i = 0; i < size.size(); ++i)
    if (moved[i] > 0.25 * std::max(size[i], least)) return true;
  return false;
}

std::optional<Vector> step_solution(const DenseScene& s, const StepProblem& p, const Vector& near) {
  if (s.lcp_class != LcpClass::Z || p.q.size() != s.M.rows()) return some_solution(p.matrix, p.q, near);
  for (const Vector& y : solutions(p.matrix, p.q)) {
    const auto least = selected_solution(s.M, p.q + (p.matrix - s.M) * y, LcpClass::Z);
    if (least && (*least - y).cwiseAbs().maxCoeff() <= 1e-7 * y.cwiseAbs().maxCoeff()) return y;
  }
  return std::nullopt;
}

Trajectory trajectory(const DenseScene& s, Scheme scheme, Index J) {
  const Index n = s.M.rows(), m = s.A.rows();
  Trajectory out{Vector::LinSpaced(J + 1, 0, s.T), RowMatrix::Constant(J + 1, n, NAN),
                 RowMatrix::Constant(J + 1, m, NAN), 0};
  const Steps main(s, scheme, J), euler(s, Scheme::euler, J);
  const auto start = selected_solution(s.M, s.N * s.x0 + value(s.g, 0, n), s.lcp_class);
  Eigen::FullPivLU<Matrix> lu(Scaled(s.M, Vector::Zero(n)).matrix);
  lu.setThreshold(rank);
  if (!start && (scheme == Scheme::exponential || lu.isInvertible())) return out;
  Vector x = s.x0, y = start.value_or(Vector::Zero(n)), Y = Vector::Zero(scheme == Scheme::radau ? 2 * n : n);
  Y.tail(n) = y;
  out.x.row(0) = x;
  if (start) out.y.row(0) = y;
  Vector regular = y;
  for (Index j = 1; j <= J; ++j) {
    out.infeasible = j;
    StepProblem p = main.problem(j, x, y);
    auto found = step_solution(s, p, Y);
    if (found) Y = *found;
    if (scheme == Scheme::radau && (!found || jumps(s, s.T / double(J), Y, x, p.free + p.drive * Y, regular))) {
      const StepProblem jump = euler.problem(j, x, y);
      if (const auto other = step_solution(s, jump, Y.tail(n))) {
        p = jump;
        found = other;
      }
    }
    if (!found) return out;
    x = p.free + p.drive * *found;
    y = found->tail(n);
    if (found->size() == 2 * n) regular = regular.cwiseMax(y);
    out.x.row(j) = x;
    out.y.row(j) = y;
  }
  out.infeasible = -1;
  return out;
}

}  // namespace bromwich::oracle
