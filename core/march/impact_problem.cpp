#include "core/march/impact_problem.hpp"

#include "core/lcp/lemke.hpp"
#include "core/lcp/solution.hpp"
#include "core/numerics/equilibration.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

constexpr double raised_for_lemke = 1e-9;      ///< of the diagonal, beside entries of 1
constexpr double rounding_of_problem = 1e-13;  ///< residual
constexpr double accepted_residual = 1e-10;    ///< residual of what a fallback finds
constexpr double slipping = 1e-9;              ///< of the bound of friction: less than that below it slips
constexpr Index most_sweeps = 4096;            ///< over rows of the orthant and cones

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

// Its rows as one block.
class OrthantBlock final : public Block {
 public:
  OrthantBlock(std::vector<Index> rows, ActiveSetLcp& lcp) : Block(std::move(rows)), lcp_(lcp) {}

  void scale(const Matrix& W, Vector& unit, Vector& rho) const override {
    const Equilibration e = equilibrate(W);
    unit = e.columns;
    rho = e.rows.cwiseProduct(e.columns);
  }
  Vector law(const Vector& z, const Vector& w, const Vector& rho, Matrix* by_z, Matrix* by_w) const override {
    const Vector open = rho.cwiseProduct(w);
    if (by_z) {
      const Vector acts = (z.array() > open.array()).select(Vector::Ones(z.size()), 0.0);
      *by_w = acts.cwiseProduct(rho).asDiagonal();
      *by_z = (Vector::Ones(z.size()) - acts).asDiagonal();
    }
    return z.cwiseMin(open);
  }
  Vector project(Vector z) const override { return z.cwiseMax(0.0); }
  bool solve(const Matrix& W, const Vector& q, Vector& z) const override {
    const ImpactSolution found = solve_impact_problem(lcp_, W, q);
    z = found.z;
    return found.solved;
  }

 private:
  ActiveSetLcp& lcp_;
};

}  // namespace

ImpactProblem::ImpactProblem(Matrix W, std::vector<ImpactCone> cones) : W_(std::move(W)), cones_(std::move(cones)) {
  std::vector<char> in_cone(std::size_t(W_.rows()), 0);
  for (const ImpactCone& cone : cones_) std::fill_n(in_cone.begin() + cone.first, 3, 1);
  for (Index i = 0; i < W_.rows(); ++i)
    if (!in_cone[std::size_t(i)]) orthant_.push_back(i);
  if (!orthant_.empty()) lcp_.emplace(W_(orthant_, orthant_), LcpClass::unknown);
}

void ImpactProblem::start_from(const Vector& z) {
  if (lcp_) lcp_->start_from(z(orthant_));
}

ImpactSolution ImpactProblem::solve(const Vector& q, const Matrix& slides) {
  ImpactSolution found = cones_.empty() ? solve_impact_problem(*lcp_, W_, q) : over_cones(q, slides);
  if (found.at_end.size() == 0) found.at_end = found.z;
  return found;
}

// Of a contact that slides along e at the begin, z_t = s - mu/2 z_n e with s the half of the end, which is in a cone of
// half the width.
ImpactSolution ImpactProblem::over_cones(const Vector& q, const Matrix& slides) {
  ImpactSolution found;
  if (!q.allFinite()) return found;
  Matrix W = W_;
  Blocks blocks;
  if (lcp_) blocks.push_back(std::make_unique<OrthantBlock>(orthant_, *lcp_));
  const auto along = [&](std::size_t k) {
    return slides.size() > 0 ? Vector(slides.col(Index(k))) : Vector(Vector::Zero(2));
  };
  for (std::size_t k = 0; k < cones_.size(); ++k) {
    const auto& [first, mu, given] = cones_[k];
    const Vector e = along(k);
    W.col(first) -= mu / 2 * (W_.middleCols(first + 1, 2) * e);
    blocks.push_back(std::make_unique<FrictionBlock>(first, e.isZero(0) ? mu : mu / 2, given));
  }
  const BlockSolution solution = solve_blocks(W, q, blocks, accepted_residual, most_sweeps);
  found.solved = solution.solved, found.residual = solution.residual, found.z = found.at_end = solution.z;
  found.newton = int(solution.newton), found.fallback = solution.sweeps > 4 * Index(blocks.size());
  for (std::size_t k = 0; k < cones_.size(); ++k) {
    const auto& [first, mu, given] = cones_[k];
    const Vector e = along(k), half = solution.z.segment(first + 1, 2);
    const double bound = mu / 2 * solution.z[first];
    if (e.isZero(0)) continue;
    found.z.segment(first + 1, 2) -= bound * e;
    const bool slips = half.norm() >= (1 - slipping) * bound;
    found.at_end.segment(first + 1, 2) = slips ? Vector(2 * half) : Vector(found.z.segment(first + 1, 2));
  }
  return found;
}

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
