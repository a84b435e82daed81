// Heat conduction in the unit square with a unilateral (Signorini) condition on the side x1 = 0, semi-discretised by
// finite differences on a Q x Q grid, dx = 1/(Q+1); example 4.2 of the paper on Laplace inversion for differential
// linear complementarity problems.
//
// symbol  here            meaning
// V       state           temperature at the interior points, lines of x1 stacked over x2
// Y       y               boundary value shifted by the obstacle psi, Y = V(0, x2) - psi                          (4.5)
// A1      -               second difference / dx^2; A = c (I ⊗ A1 + A1 ⊗ I), M = 2 I - dx^2 A1 = tridiag(-1,4,-1)
// B, N    I ⊗ b, I ⊗ n^T  b = c/dx^2 e_1, n = -2 e_1
// f, g    B psi, M psi
// V(0)    x0              2 x1 x2 (1-x1)(1-x2)                                                                    (4.7)

#include "catalogue/recipes.hpp"
#include "core/scene/separable.hpp"

#include <cmath>
#include <cstdlib>
#include <limits>
#include <numbers>

namespace bromwich {
namespace {

constexpr double most_points = 4095;

Index points_per_side(const ParameterValues& values) {
  if (const double dx = values.at("dx"); !std::isnan(dx)) {
    const double cells = 1 / dx, rounded = std::round(cells);
    // A spacing is a rounded decimal: six digits must be enough to determine the integer.
    if (!(dx > 0) || !(std::abs(cells - rounded) <= 1e-6 * cells) || rounded < 2 || rounded > most_points + 1)
      throw Error("dx", "found " + number_text(dx) + ", that is Q = 1/dx - 1 = " + number_text(cells - 1),
                  "give 1/(Q+1) for an integer Q from 1 to 4095, or give Q");
    return Index(rounded) - 1;
  }
  const double Q = values.at("Q");
  if (!(Q >= 1 && Q <= most_points) || Q != std::floor(Q))
    throw Error("Q", "found " + number_text(Q), "give an integer from 1 to 4095");
  return Index(Q);
}

/// psi(t, x2) at the Q interior points of the side: 4/(1+t) where |x2 - 1/2| >= 1/4, sin 2 pi t between.
SeparableSource obstacle(Index Q) {
  const Index cells = Q + 1;
  Matrix shapes = Matrix::Zero(Q, 2);
  for (Index i = 1; i <= Q; ++i)  // in units of dx/4, so that x2 = 1/4 and 3/4 are exact
    shapes(i - 1, std::abs(4 * i - 2 * cells) >= cells ? 0 : 1) = 1;
  return {shapes, [](double t, Eigen::Ref<Vector> a) { a << 4 / (1 + t), std::sin(2 * std::numbers::pi * t); }};
}

Scene build_signorini(const ParameterValues& values) {
  const Index Q = points_per_side(values);
  Scene scene;
  scene.dynamics = heat_with_boundary_value(Q, 2, positive_parameter(values, "c"));
  scene.M = Tridiagonal{Vector::Constant(Q, -1), Vector::Constant(Q, 4), Vector::Constant(Q, -1)};
  scene.lcp_class = LcpClass::P;  // strictly diagonally dominant with positive diagonal
  const SeparableSource psi = obstacle(Q);
  scene.f = psi;
  scene.breakpoints_are_all = true;
  scene.f_entry = SourceEntry::through_B;
  Matrix M_psi = 4 * psi.shapes;
  M_psi.topRows(Q - 1) -= psi.shapes.bottomRows(Q - 1);
  M_psi.bottomRows(Q - 1) -= psi.shapes.topRows(Q - 1);
  scene.g = SeparableSource{M_psi, psi.time};
  const Vector line = bump(Q);
  scene.x0.resize(Q * Q);
  for (Index i = 0; i < Q; ++i) scene.x0.segment(i * Q, Q) = 2 * line[i] * line;
  scene.T = positive_parameter(values, "T");
  scene.default_steps = 400;
  return scene;
}

}  // namespace

KroneckerDynamics heat_with_boundary_value(Index Q, int directions, double c) {
  const double dx = 1.0 / double(Q + 1);
  KroneckerDynamics heat;
  heat.along = heat.across = SecondDifference{Q, dx, c};
  if (directions == 3) heat.beside = {heat.along};
  heat.b = Vector::Zero(Q);
  heat.b[0] = c / (dx * dx);
  heat.n = Vector::Zero(Q);
  heat.n[0] = -2;
  return heat;
}

Vector bump(Index Q) {
  const double dx = 1.0 / double(Q + 1);
  const Vector x = Vector::LinSpaced(Q, dx, double(Q) * dx);
  return x.array() * (1 - x.array());
}

SceneRecipe signorini_recipe() {
  return {"signorini",
          "heat in a square with a unilateral condition on one side, Q x Q interior points",
          {{"Q", 39, "interior points per side, 1 to 4095"},
           {"dx", std::numeric_limits<double>::quiet_NaN(), "grid spacing 1/(Q+1), instead of Q", "Q"},
           {"c", 2e-3, "diffusivity"},
           {"T", 4, "final time"}},
          build_signorini};
}

}  // namespace bromwich
