#include "core/march/impact_problem.hpp"

#include "core/lcp/lemke.hpp"
#include "core/lcp/solution.hpp"
#include "core/numerics/equilibration.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich {

namespace {

constexpr double raised_for_lemke = 1e-9;      ///< of the diagonal, beside entries of 1
constexpr double rounding_of_problem = 1e-13;  ///< residual
constexpr double accepted_residual = 1e-10;    ///< residual of what a fallback finds

// The natural map, with unknowns in units of the largest, and rows in units of what that moves. A force that is
// rounding of larger ones, as where a contact parts, is none.
double residual_of(const Matrix& W, const Vector& q, const Vector& z) {
  const double unit = std::max({q.cwiseAbs().maxCoeff(), z.cwiseAbs().maxCoeff(), 1e-290});
  const Vector w = W * z + q, units = unit * (W.cwiseAbs().rowwise().sum().array() + 1);
  return w.cwiseQuotient(units).cwiseMin(z / unit).cwiseAbs().maxCoeff();
}

// The linear system of the set {z > 0}, where that is more accurate: pivots leave rounding behind.
void polish(const Matrix& W, const Vector& q, const std::vector<Index>& S, ImpactSolution& found) {
  if (S.empty()) return;
  const Equilibration e = equilibrate(W);
  const Matrix own = scaled(W, e)(S, S);
  const Vector of_S = own.completeOrthogonalDecomposition().solve(Vector(-e.rows.cwiseProduct(q)(S)));
  Vector z = Vector::Zero(q.size());
  z(S) = of_S;
  z = e.columns.cwiseProduct(z).cwiseMax(0.0);
  const double residual = residual_of(W, q, z);
  if (!(residual <= std::max(found.residual, rounding_of_problem))) return;
  found.z = z;
  found.residual = residual;
}

}  // namespace

ImpactSolution solve_impact_problem(ActiveSetLcp& lcp, const Matrix& W, const Vector& q) {
  ImpactSolution found;
  if (!q.allFinite()) return found;
  if ((q.array() >= 0).all()) {
    found.z = Vector::Zero(q.size());
    found.solved = true;
    return found;
  }
  const LcpOutcome outcome = lcp.solve(q, found.z);
  found.newton = outcome.newton, found.fallback = outcome.fallback, found.solved = outcome.solved;
  if (found.solved) {
    found.residual = residual_of(W, q, found.z);
    if (found.fallback) polish(W, q, support_of(found.z), found);
    return found;
  }
  found.fallback = true;
  const Equilibration e = equilibrate(W);
  Matrix larger = scaled(W, e);
  larger.diagonal().array() += raised_for_lemke;
  const LemkeOutcome pivoted = lemke(larger, e.rows.cwiseProduct(q));
  if (!pivoted.solved) return found;
  found.z = e.columns.cwiseProduct(pivoted.y);
  found.residual = residual_of(W, q, found.z);
  polish(W, q, pivoted.basis, found);
  found.solved = found.residual <= accepted_residual;
  return found;
}

double first_fall(const Cubic& c, double d, double zero) {
  const double a = c.slope0 * d, rise = c.w1 - c.w0, end = c.slope1 * d, b = 3 * rise - 2 * a - end,
               e = a + end - 2 * rise;
  const auto at = [&](double s) { return s == 1 ? c.w1 : c.w0 + s * (a + s * (b + s * e)); };
  std::vector<double> ends{0};  // of intervals on which it rises or falls
  const double root = b * b - 3 * e * a;
  if (root > 0) {
    const double sum = -(b + std::copysign(std::sqrt(root), b));
    for (const double s : {sum / (3 * e), a / sum})
      if (s > 0 && s < 1) ends.push_back(s);
    std::sort(ends.begin(), ends.end());
  }
  ends.push_back(1);
  for (std::size_t k = 0; k + 1 < ends.size(); ++k) {
    double from = ends[k], to = ends[k + 1];
    if (!(at(from) >= 0) || !(at(to) < -zero)) continue;
    for (int halved = 0; halved < 100 && to - from > epsilon * to; ++halved)
      (at((from + to) / 2) >= 0 ? from : to) = (from + to) / 2;
    return to * d;
  }
  return INFINITY;
}

}  // namespace bromwich
