#include "core/accuracy/settled_y.hpp"

#include "core/lcp/active_set.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <vector>

namespace bromwich {

namespace {

constexpr double part_of_a_step = 1.0 / 64;
constexpr double accepted_at_point = 1e-10;  ///< of the problem at the time point
constexpr double counts_as_zero = 1e-9;      ///< y relative to the largest one, and w to its terms
constexpr Index most_settled_constraints = 128;

// A step of implicit Euler from x: q = N (E/d - A)^{-1} (E x/d + f) + g, matrix M + N (E/d - A)^{-1} B.
struct BriefStep {
  double length;
  std::unique_ptr<ShiftedSystem<double>> shifted;
  ActiveSetLcp lcp;
};

std::optional<BriefStep> brief_step(const LinearSystem& dynamics, const Matrix& M, double length) {
  auto shifted = dynamics.at_shift(1 / length);
  if (!shifted) return std::nullopt;
  const Matrix implicit = M + dynamics.outputs() * shifted->solve(Matrix(dynamics.inputs()));
  if (!implicit.allFinite()) return std::nullopt;
  const LcpClass lcp_class = classify(LcpMatrix(implicit));
  if (!has_convex_solutions(lcp_class)) return std::nullopt;
  return BriefStep{length, std::move(shifted), ActiveSetLcp(implicit, lcp_class)};
}

// A constraint of positions is passed with a velocity: y of a brief step behind the contact is its impulse.
bool has_rigid_constraint(const LinearSystem& dynamics, const Matrix& M, double h) {
  const SparseMatrix B = dynamics.rates_of_inputs(h);
  const Eigen::SparseMatrix<double, Eigen::RowMajor> N = dynamics.outputs();
  for (Index i = 0; i < M.rows(); ++i) {
    const double first = N.row(i).dot(B.col(i)), terms = N.row(i).cwiseAbs().dot(B.col(i).cwiseAbs());
    if (M(i, i) == 0 && std::abs(first) <= counts_as_zero * terms) return true;
  }
  return false;
}

struct Brief {
  explicit Brief(const DiscreteProblem& problem)
      : p(problem),
        dynamics(*problem.scene.dynamics),
        M(to_dense(p.scene.M)),
        resolution(p.sources ? p.sources->resolution : 256 * epsilon * p.scene.T),
        f(p.scene.f, p.scene.f ? p.scene.sources() : 0, resolution),
        g(p.scene.g, p.scene.g ? p.scene.constraints() : 0, resolution) {
    if (p.scene.f) F = source_matrix(p);
    if (has_rigid_constraint(dynamics, M, p.h)) return;
    for (std::size_t k = 0; k < steps.size(); ++k)
      steps[k] = brief_step(dynamics, M, double(k + 1) * part_of_a_step * p.h);
  }

  // y at row j, which has been `y`; empty: unknown.
  std::optional<Vector> settled(Index j, const Vector& x, const Vector& y) {
    if (!steps[0] || !steps[1] || meets_breakpoint(j)) return std::nullopt;
    Vector soon, later;
    if (!take(*steps[0], j, x, y, soon) || !take(*steps[1], j, x, soon, later)) return std::nullopt;
    const bool same = ((soon.array() > 0) == (later.array() > 0)).all();
    return on_constraints(j, x, same ? Vector((2 * soon - later).cwiseMax(0)) : soon);
  }

  bool meets_breakpoint(Index j) const {
    const double part = 2 * part_of_a_step * p.h;
    const double from = j < p.J ? p.t[j] + resolution : p.t[j] - part, to = from + part;
    const auto next = std::lower_bound(p.scene.breakpoints.begin(), p.scene.breakpoints.end(), from);
    return next != p.scene.breakpoints.end() && *next <= to;
  }

  // The source `ahead` of row j. Behind T it goes on as a line.
  Vector source(const OneSided& s, Index j, double ahead) const {
    Vector value, before;
    s.value(j < p.J ? p.t[j] + ahead : p.t[j], value);
    if (j < p.J) return s.whole(value);
    s.value(p.t[j] - ahead, before);
    return s.whole(2 * value - before);
  }

  bool take(BriefStep& step, Index j, const Vector& x, const Vector& guess, Vector& y) const {
    Vector moved = dynamics.times_mass(x) / step.length;
    if (F.size() > 0) moved += F * source(f, j, step.length);
    Vector q = dynamics.observe(step.shifted->solve(moved));
    if (p.scene.g) q += source(g, j, step.length);
    step.lcp.start_from(guess);
    return q.allFinite() && step.lcp.solve(q, y).solved;
  }

  // The nearest y of the same active set that solves the problem at row j.
  std::optional<Vector> on_constraints(Index j, const Vector& x, Vector y) const {
    const Vector q = dynamics.observe(x) + p.g.row(j);
    std::vector<Index> active;
    for (Index i = 0; i < y.size(); ++i)
      if (y[i] > 0) active.push_back(i);
    if (!active.empty()) {
      const Matrix own = M(active, active);
      const Vector off = (M * y + q)(active);
      y(active) -= own.completeOrthogonalDecomposition().solve(off);
    }
    y = y.cwiseMax(0);
    const Vector w = M * y + q;
    const double missed = y.cwiseMin(w).cwiseAbs().maxCoeff(), size = std::max(1.0, q.cwiseAbs().maxCoeff());
    return missed <= accepted_at_point * size ? std::optional(y) : std::nullopt;
  }

  const DiscreteProblem& p;
  const LinearSystem& dynamics;
  Matrix F, M;
  double resolution;
  OneSided f, g;
  std::array<std::optional<BriefStep>, 2> steps;
};

}  // namespace

RowMatrix settled_y(const DiscreteProblem& p, const RowMatrix& x, const Result& result) {
  RowMatrix y = result.y;
  if (!p.small_state() || has_one_solution(p.lcp_class) || p.scene.constraints() > most_settled_constraints ||
      x.rows() != p.J + 1)
    return y;
  const double zero = counts_as_zero * y.cwiseAbs().maxCoeff();
  std::optional<Brief> brief;
  for (Index j = 1; j <= p.J; ++j) {
    const auto active = [&](Index row) { return (result.y.row(row).array() > zero).eval(); };
    if ((active(j) == active(j - 1)).all() && !(p.sources && p.sources->at(j))) continue;
    if (!brief) brief.emplace(p);
    if (const auto settled = brief->settled(j, x.row(j).transpose(), result.y.row(j).transpose()))
      y.row(j) = settled->transpose();
  }
  return y;
}

UnsettledRows unsettled_rows(const RowMatrix& y, const RowMatrix& settled, double share) {
  UnsettledRows rows;
  if (y.size() == 0) return rows;
  const Vector largest = settled.cwiseAbs().colwise().maxCoeff().transpose();
  const Vector size = largest.cwiseMax(1e-3 * largest.maxCoeff()).cwiseMax(1e-290);
  for (Index j = 1; j < y.rows(); ++j) {
    const double off = (y.row(j) - settled.row(j)).transpose().cwiseAbs().cwiseQuotient(size).maxCoeff();
    if (!(off > share)) continue;
    if (rows.count++ == 0) rows.first = j;
    rows.error = std::max(rows.error, off);
  }
  return rows;
}

}  // namespace bromwich
