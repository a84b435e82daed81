#include "core/base/text.hpp"
#include "core/galerkin/solvers.hpp"
#include "core/lcp/active_set.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/lcp/lemke.hpp"
#include "core/lcp/solution.hpp"

#include <Eigen/Dense>

namespace bromwich {

namespace {

RowMatrix in_rows(const Vector& z, const GalerkinProblem& p) {
  return Eigen::Map<const RowMatrix>(z.data(), p.N, p.unknowns());
}

// z -> w as a matrix, from unit vectors.
Matrix assembled(const GalerkinProblem& p) {
  const Index size = p.N * p.unknowns();
  Matrix L(size, size);
  for (Index i = 0; i < size; ++i) {
    const RowMatrix w = apply_galerkin(p, in_rows(Vector::Unit(size, i), p));
    L.col(i) = Eigen::Map<const Vector>(w.data(), size);
  }
  return L;
}

}  // namespace

GalerkinSolution pivot_assembled(const GalerkinProblem& p, const Options&) {
  const Index size = p.N * p.unknowns();
  const RowMatrix zero = RowMatrix::Zero(p.N, p.unknowns());
  const RowMatrix w = galerkin_slack(p, zero, galerkin_states(p, zero));
  const Vector q = Eigen::Map<const Vector>(w.data(), size);
  const Matrix L = assembled(p);
  GalerkinSolution s;
  s.lcp.fallbacks = 1;
  s.bytes = 3 * sizeof(double) * std::size_t(size * size);
  s.z = zero;
  if (is_PSD(L)) {
    const LeastNorm found = least_norm_solution(L, q);
    s.how = "the assembled problem, least norm";
    s.iterations = found.problems;
    if (found.solved) s.z = in_rows(found.y, p);
    if (found.infeasible) s.infeasible = 0;
    s.status = found.solved ? Status::solved : found.infeasible ? Status::infeasible : Status::tolerance_not_met;
  } else {
    const Equilibration e = equilibrate(L);
    const LemkeOutcome found = lemke(e.rows.asDiagonal() * L * e.columns.asDiagonal(), e.rows.cwiseProduct(q));
    s.how = text("Lemke's method on the assembled problem, %d pivots", found.pivots);
    s.iterations = found.pivots;
    if (found.solved) s.z = in_rows(e.columns.cwiseProduct(found.y), p);
    s.status = found.solved ? Status::solved : Status::tolerance_not_met;
  }
  if (s.status == Status::infeasible) s.reason = "the discrete problem has no feasible point (it is monotone)";
  if (s.status == Status::tolerance_not_met) s.reason = "pivoting on the assembled problem found no solution";
  s.x = galerkin_states(p, s.z);
  return s;
}

}  // namespace bromwich
