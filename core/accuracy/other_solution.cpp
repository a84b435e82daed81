#include "core/accuracy/other_solution.hpp"

#include "core/lcp/active_set.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/lcp/other_solutions.hpp"

#include <Eigen/LU>

#include <algorithm>

namespace bromwich {

namespace {

constexpr std::size_t most_rows = 24;

std::vector<Index> rows_to_look_at(const RowMatrix& y) {
  const Index J = y.rows() - 1;
  std::vector<Index> rows{1};
  for (Index j = 2; j <= J && rows.size() < most_rows / 2; ++j)
    if (((y.row(j).array() > 0) != (y.row(j - 1).array() > 0)).any()) rows.push_back(j);
  const Index stride = std::max<Index>(1, J / Index(most_rows / 2));
  for (Index j = stride; j <= J; j += stride) rows.push_back(j);
  std::sort(rows.begin(), rows.end());
  rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
  return rows;
}

// Implicit Euler from x_{j-1}: LCP(q_j, M + N R B) with R = h (I - hA)^{-1}, x_j = R (x_{j-1}/h + f_j + B y_j).
struct EulerStep {
  Matrix decay, drive, implicit;
};

std::optional<EulerStep> euler_step(const DiscreteProblem& p) {
  const DenseDynamics& d = *p.small_state();
  const Index m = d.A.rows();
  const Eigen::PartialPivLU<Matrix> lu(Matrix::Identity(m, m) - p.h * d.A);
  if (m > 0 && !(lu.rcond() > epsilon)) return std::nullopt;
  const Matrix decay = lu.inverse(), drive = p.h * decay * d.B;
  return EulerStep{decay, drive, to_dense(p.scene.M) + d.N * drive};
}

}  // namespace

OtherSolution other_solution(const DiscreteProblem& p, const Result& result, const RowMatrix& x, bool at_corners) {
  OtherSolution found;
  const Index n = p.scene.constraints();
  if (n == 0 || n > (at_corners ? largest_moved : largest_searched) || x.rows() != p.J + 1 || !x.allFinite())
    return found;
  const std::optional<EulerStep> step = euler_step(p);
  if (!step) return found;
  found.searched = n <= largest_searched;
  if (!has_convex_solutions(p.lcp_class) && result.y.row(0).allFinite())
    if (another_solution(to_dense(p.scene.M), p.start, result.y.row(0).transpose(), at_corners)) {
      found.row = 0;
      found.moves_the_state = false;
      return found;
    }
  const LcpClass of_steps = classify(LcpMatrix(step->implicit));
  if (has_one_solution(of_steps)) return found;
  ActiveSetLcp lcp(step->implicit, of_steps);
  const SolutionsBeside others(step->implicit);
  // y may belong to another method than implicit Euler: two solutions of one problem are compared.
  const auto one = [&](const Vector& q, const Vector& y) {
    if (found.searched) return others.nearest(q, y, at_corners);
    Vector first;
    return lcp.solve(q, first).solved ? std::optional(first) : std::nullopt;
  };
  const RowMatrix f = state_input(p, RowMatrix::Zero(p.J + 1, n)), g = p.g.table();
  for (const Index j : rows_to_look_at(result.y)) {
    const Vector free = step->decay * (x.row(j - 1) + p.h * f.row(j)).transpose();
    const Vector q = p.small_state()->N * free + g.row(j).transpose(), y = result.y.row(j).transpose();
    const auto first = one(q, y);
    if (!first) continue;
    const auto second = others.nearest(q, *first, at_corners);
    if (!second) continue;
    found.row = j;
    const Vector moved = step->drive * (*first - *second),
                 terms = step->drive.cwiseAbs() * (first->cwiseAbs() + second->cwiseAbs());
    found.moves_the_state = (moved.array().abs() > 1e-8 * terms.array().max(1e-300)).any();
    if (found.moves_the_state) return found;
  }
  return found;
}

}  // namespace bromwich
