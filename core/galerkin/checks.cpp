#include "core/galerkin/checks.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/galerkin/uniqueness.hpp"
#include "core/numerics/two_point.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <optional>

namespace bromwich {

namespace {

constexpr double singular_boundary = 1e-13;  ///< reciprocal condition
constexpr double dependent_rows = 1e-13;     ///< of [E0 ET], rows of size 1
constexpr Index most_looked_at = 64;         ///< states: above, the eigenvalues cost more than the solution
constexpr Index coarse_intervals = 32;
constexpr double clearly_positive = 1e-6;  ///< an eigenvalue, relative to M: as well as it is computed

// With the weight e^{-exponent t/T} the boundary condition may leave states open that it determines without.
std::optional<double> eigenvalue_where_determined(const Scene& scene, Index N, double exponent) {
  try {
    return smallest_symmetric_eigenvalue(scene, N, exponent / scene.T);
  } catch (const Error&) {
    return std::nullopt;
  }
}

}  // namespace

void require_independent_rows(const BoundaryCondition& c) {
  const Index m = c.b.size();
  Matrix rows(m, 2 * m);
  rows << c.E0, c.ET;
  for (Index i = 0; i < m; ++i) {
    const double size = rows.row(i).cwiseAbs().maxCoeff();
    if (size == 0)
      throw Error("boundary", text("row %ld of E0 and ET is zero", long(i)), "give one condition per state");
    rows.row(i) /= size;
  }
  Eigen::ColPivHouseholderQR<Matrix> qr(rows.transpose());
  qr.setThreshold(dependent_rows);
  if (qr.rank() == m) return;
  // A combination of rows that vanishes, and the same combination of b.
  const Matrix null = Eigen::FullPivLU<Matrix>(rows.transpose()).setThreshold(1e-12).kernel();
  Vector b(m);
  for (Index i = 0; i < m; ++i)
    b[i] = c.b[i] / std::max(c.E0.row(i).cwiseAbs().maxCoeff(), c.ET.row(i).cwiseAbs().maxCoeff());
  const bool contradict = (null.transpose() * b).cwiseAbs().maxCoeff() > 1e-10 * std::max(1.0, b.cwiseAbs().maxCoeff());
  throw Error("boundary",
              text("the rows of [E0 ET] have rank %ld of %ld", long(qr.rank()), long(m)) +
                  (contradict ? " and b contradicts them" : ""),
              "give independent conditions, one per state");
}

void refuse_open_mode(double reciprocal_condition) {
  throw Error(
      "boundary", text("E0 + ET e^{TA} is singular (reciprocal condition %.1e)", reciprocal_condition),
      "without y a mode is left open (periodic: one that is kept, or whose period divides T); use method shooting, "
      "give conditions that determine the states of the scene without y, or damp the mode");
}

double require_determined_states(const GalerkinProblem& p) {
  if (p.initial_value) return 1;
  require_independent_rows(p.boundary);
  const Vector none = Vector::Zero(p.states());
  Segment all = repeated(p.first_step().E, none, p.runs.front().count);
  for (std::size_t i = 1; i < p.runs.size(); ++i) all = joined(all, repeated(p.runs[i].step.E, none, p.runs[i].count));
  const double condition = solve_ends(all, p.boundary).reciprocal_condition;
  if (!(condition >= singular_boundary)) refuse_open_mode(condition);
  return condition;
}

Uniqueness uniqueness_of(const Scene& scene, Index N) {
  if (scene.states() > most_looked_at) return {};
  const double size = std::max(to_dense(scene.M).cwiseAbs().maxCoeff(), 1e-300);
  double best = -INFINITY;
  for (const double exponent : {0.0, 2.0, -2.0}) {
    const std::optional<double> sigma = eigenvalue_where_determined(scene, std::min(N, coarse_intervals), exponent);
    if (!sigma) continue;
    if (*sigma > clearly_positive * size) return {true, *sigma};
    best = std::max(best, *sigma);
  }
  return {false, std::abs(best) <= clearly_positive * size ? 0 : best};
}

}  // namespace bromwich
