#include "core/weight_check.hpp"

#include "core/kernel.hpp"
#include "core/phi.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

// W_0, W_1, W_2, S_1 in this order, one row each.
RowMatrix first_weights(const LagTable& table) {
  RowMatrix rows(4, table.W.cols());
  rows << table.W.topRows(3), table.S.row(1);
  return rows;
}

RowMatrix circle_weights(const DiscreteProblem& p, const Contour& contour) {
  const ComplexMatrix R = p.backend.resolvent(p.scene.dynamics, contour.nodes);
  ComplexMatrix F(4, contour.nodes.size());
  for (Index q = 0; q < F.cols(); ++q) {
    const Complex x = p.h * contour.nodes[q], p1 = phi1(x), p2 = phi2(x), c = p.h * contour.weights[q];
    F.col(q) << c * p2, c * p1 * p1, c * std::exp(x) * p1 * p1, c * (p1 - p2);
  }
  return (F * R).real();
}

}  // namespace

WeightCheck check_weights(const DiscreteProblem& p, const DenseRecurrence& recurrence, double operations) {
  const double m = double(p.scene.states()), n = double(p.scene.constraints());
  constexpr double nodes = 100;
  if (nodes * (4 * m * m * m + m * m * n) > operations || p.J < 2) return {NAN, ""};
  const Spectrum where = spectrum(p.scene.dynamics);
  const RowMatrix made = first_weights(lag_table(recurrence, 2));
  const double scale = std::max(made.cwiseAbs().maxCoeff(), 1e-300);
  const auto deviation = [&](const RowMatrix& other) { return (made - other).cwiseAbs().maxCoeff() / scale; };
  if (const auto around = circle(where.radius, p.h))
    return {deviation(circle_weights(p, *around)), "a circle of 64 nodes around the spectrum"};
  const auto parameters = contour_parameters(where.half_angle);
  if (!parameters) return {NAN, ""};
  return {deviation(first_weights(contour_lag_table(p.backend, p.scene.dynamics, *parameters, p.h, 2))),
          "contours of " + std::to_string(parameters->P + 1) + " nodes"};
}

}  // namespace bromwich
