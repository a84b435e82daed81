#include "core/kernel/weight_check.hpp"

#include "core/kernel/kernel.hpp"
#include "core/numerics/matrix_phi.hpp"
#include "core/numerics/phi.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace bromwich {

namespace {

// W_0, W_1, W_2, S_1 in this order, one per row.
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

// The weights from e^{hA} made of two steps of h/2: other scaling, other rounding.
RowMatrix doubled_weights(const DiscreteProblem& p) {
  const DenseDynamics& d = *p.small_state();
  const Matrix I = Matrix::Identity(d.A.rows(), d.A.cols());
  const MatrixPhi half = matrix_phi(0.5 * p.h * d.A);
  const Matrix p2 = (half.phi1 * half.phi1 + 2 * half.phi2) / 4, p1 = (half.exponential + I) * half.phi1 / 2;
  const StepOperators step{half.exponential * half.exponential, p.h * (p1 - p2), p.h * p2};
  return first_weights(lag_table(dense_recurrence(d, step), 2));
}

constexpr double wider_angle = std::numbers::pi / 12, widest_angle = std::numbers::pi / 3;

std::optional<RowMatrix> by_contour(const DiscreteProblem& p, double half_angle) {
  const auto parameters = contour_parameters(half_angle);
  if (!parameters) return std::nullopt;
  return first_weights(contour_lag_table(p.backend, p.scene.dynamics, *parameters, p.h, 2));
}

}  // namespace

WeightCheck check_weights(const DiscreteProblem& p, const DenseRecurrence& recurrence, double operations) {
  const double m = double(p.scene.states()), n = double(p.scene.constraints());
  constexpr double nodes = 100;
  if (nodes * (4 * m * m * m + m * m * n) > operations || p.J < 2) return {NAN, ""};
  if (needs_precision(p.small_state()->A, p.h, p.J)) return {NAN, ""};  // too few digits are known to check it
  constexpr double agreed = 1e-9;                                       ///< if two agree to this, no third is computed
  const Spectrum where = p.shared->spectrum();
  const RowMatrix made = first_weights(lag_table(recurrence, 2));
  const double scale = std::max(made.cwiseAbs().maxCoeff(), 1e-300);
  const auto apart = [&](const RowMatrix& a, const RowMatrix& b) { return (a - b).cwiseAbs().maxCoeff() / scale; };
  const auto around = circle(where.radius, p.h);
  const auto parameters = contour_parameters(where.half_angle);
  if (!around && !parameters) return {NAN, ""};
  const std::string words = around ? "a circle of 64 nodes around the spectrum"
                                   : "contours of " + std::to_string(parameters->P + 1) + " nodes";
  const RowMatrix other = around ? circle_weights(p, *around) : *by_contour(p, where.half_angle);
  const double deviation = apart(made, other);
  if (deviation <= agreed) return {deviation, words};
  // The second result counts only as far as another contour around the same spectrum confirms it: for highly non-normal
  // matrices, contours may cut the pseudospectrum.
  const auto wider = around ? circle(1.5 * where.radius, p.h) : std::nullopt;
  const auto again = wider ? std::optional(circle_weights(p, *wider))
                           : by_contour(p, std::min(where.half_angle + wider_angle, widest_angle));
  const double own = again ? apart(other, *again) : INFINITY;
  if (own < deviation / 3) return {deviation, words};
  return {apart(made, doubled_weights(p)), "steps of h/2 (contours do not agree with each other)"};
}

}  // namespace bromwich
