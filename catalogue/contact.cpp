// Heat conduction in the unit square with a contact condition on the side x1 = 0, semi-discretised by finite
// differences on a Q x Q grid, dx = 1/(Q+1). y is the heat flux into the body, w the gap that its trace leaves:
//
//     0 <= y  ⊥  w = trace + eps y + g >= 0,
//
// a contact with a Lagrange multiplier for eps = 0, with a compliance for eps > 0.
//
// symbol  here            meaning
// V       state           temperature at the interior points, lines of x1 stacked over x2
// A1      -               c times the second difference / dx^2; A = I ⊗ A1 + A1 ⊗ I
// B, N    I ⊗ b, I ⊗ n^T  b = e_1 / dx, n = e_1
// M       M               eps I
// g       g               s(t) sin(3t)/2 sin(pi x) (1 + cos(5x)/2) + s(t) sin(7 pi x)/20, s(t) = 1 - e^{-5t}
// V(0)    x0              0

#include "catalogue/recipes.hpp"

#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

constexpr double most_points_a_side = 4095;

Index contacts_per_side(const ParameterValues& values) {
  const double Q = values.at("Q");
  if (!(Q >= 1 && Q <= most_points_a_side) || Q != std::floor(Q))
    throw Error("Q", "found " + number_text(Q), "give an integer from 1 to 4095");
  return Index(Q);
}

double compliance(const ParameterValues& values) {
  const double eps = values.at("eps");
  if (!(eps >= 0)) throw Error("eps", "found " + number_text(eps), "give a number that is not negative");
  return eps;
}

/// g at the Q points of the side: two shapes with one amplitude each.
SeparableSource given_gap(Index Q) {
  using std::numbers::pi;
  Matrix shapes(Q, 2);
  for (Index k = 1; k <= Q; ++k) {
    const double x = double(k) / double(Q + 1);
    shapes.row(k - 1) << 0.5 * std::sin(pi * x) * (1 + 0.5 * std::cos(5 * x)), 0.05 * std::sin(7 * pi * x);
  }
  return {shapes, [](double t, Eigen::Ref<Vector> a) {
            const double rise = -std::expm1(-5 * t);
            a << std::sin(3 * t) * rise, rise;
          }};
}

Scene build_contact(const ParameterValues& values) {
  const Index Q = contacts_per_side(values);
  const double c = positive_parameter(values, "c"), eps = compliance(values), dx = 1 / double(Q + 1);

  KroneckerDynamics heat;
  heat.along = heat.across = SecondDifference{Q, dx, c};
  heat.b = heat.n = Vector::Unit(Q, 0);
  heat.b /= dx;

  Scene scene;
  scene.dynamics = std::move(heat);
  scene.M = Tridiagonal{Vector::Zero(Q), Vector::Constant(Q, eps), Vector::Zero(Q)};
  scene.lcp_class = eps > 0 ? LcpClass::P : LcpClass::PSD;
  scene.g = given_gap(Q);
  scene.breakpoints_are_all = true;
  scene.x0 = Vector::Zero(Q * Q);
  scene.T = positive_parameter(values, "T");
  scene.default_steps = 400;
  return scene;
}

}  // namespace

SceneRecipe contact_recipe() {
  return {"contact",
          "heat in a square with contact on one side, rigid or with a compliance, Q x Q interior points",
          {{"Q", 39, "interior points per side, 1 to 4095"},
           {"c", 0.05, "diffusivity"},
           {"eps", 0, "compliance, M = eps I; 0: rigid"},
           {"T", 4, "final time"}},
          build_contact};
}

}  // namespace bromwich
