#include "core/goal/indicators.hpp"

#include <cmath>

namespace bromwich {
namespace {

/// l taken as the value at the end of its cell, linear in between.
RowMatrix interpolated_weights(const RowMatrix& l) {
  const Index M = l.rows() - 1;
  RowMatrix z = RowMatrix::Zero(2 * M + 1, l.cols());
  for (Index i = 1; i <= M; ++i) {
    const Index before = std::max<Index>(i - 1, 1), behind = i > 1 ? i : std::min<Index>(2, M);
    const auto change = l.row(behind) - l.row(before);
    z.row(2 * i - 1) = l.row(before);
    z.row(2 * i) = l.row(before) + 0.5 * change;
  }
  return z;
}

}  // namespace

Vector weighted_residual(Backend& backend, const StepChainProblem& fine, const RowMatrix& d, const RowMatrix& x,
                         const RowMatrix& gradient, CellWeights weights, const RowMatrix& l,
                         const AdjointChoice& choice) {
  const auto chain = backend.step_chain(fine);
  const auto of_steps = [&]() -> Vector {
    switch (weights) {
      case CellWeights::local:
        return chain->locally_weighted_residual(d, x, gradient, l);
      case CellWeights::interpolated:
        return chain->weighted_residual(d, x, interpolated_weights(l));
      case CellWeights::global:
        break;
    }
    return chain->weighted_residual(d, x, chain->solve_transposed(gradient, choice));
  }();
  return Vector::NullaryExpr(fine.steps() / 2, [&](Index c) { return of_steps[2 * c] + of_steps[2 * c + 1]; });
}

double indicator_scale(StepScheme scheme, const QuantityOfInterest& quantity) {
  return -quantity.secant() / (1 - std::exp2(-order(scheme)));
}

void add_quadrature_errors(const QuantityOfInterest& quantity, const Trajectory& coarse, const Trajectory& fine,
                           Vector& indicators) {
  const Vector here = quantity.integrals(coarse);
  if (here.size() > 0) indicators += (here - quantity.integrals(fine)) / (1 - std::exp2(-order(coarse.scheme)));
}

Vector goal_indicators(const Trajectory& path, Backend& backend, const QuantityOfInterest& quantity,
                       CellWeights weights, const RowMatrix& l, const AdjointChoice& choice) {
  const PortSystem& system = path.system;
  const Vector t = halved(path.t);
  const RowMatrix x = prolonged(path);
  const Trajectory fine{system, path.scheme, t, x, 2 * path.per_cell, nullptr, &backend};
  const RowMatrix gradient = quantity.gradient(fine);
  const StepChainProblem problem = system.step_problem(path.scheme, group_steps(t));
  const RowMatrix d = step_sources(system, path.scheme, t, path.x.row(0).transpose(), &backend);
  Vector indicators =
      indicator_scale(path.scheme, quantity) * weighted_residual(backend, problem, d, x, gradient, weights, l, choice);
  add_quadrature_errors(quantity, path, fine, indicators);
  return indicators;
}

}  // namespace bromwich
