#include "core/numerics/contour.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

constexpr double degree = std::numbers::pi / 180;

// Errors are maxima over t in [t0, 5 t0] and over the rays of the sector. The near shapes give the weights of lags 0
// and 1 with an error of 1e-15 h.
// clang-format off
constexpr std::array<ContourParameters, 6> parameter_table{{
    // half-angle   P   window: gamma, spacing, mu                                   error    near: gamma, spacing, mu
    { 0 * degree, 21, {1.0727203598835797, 0.10255199568324819, 8.017019961323617}, 2.4e-13, {0.8747230668157121,  0.095464762163727485, 12.699437209120001}},
    { 0 * degree, 24, {1.0430058100318390, 0.09818070360996706, 7.468642467551716}, 7.0e-15, {0.70948548030263736, 0.11496891620580689,   5.9838624686408988}},
    {15 * degree, 28, {0.886512, 0.110112,  3.67963},                               1.9e-15, {0.63471622526539417, 0.11991345751336399,   3.327332180945608}},
    {30 * degree, 36, {0.716430, 0.103542,  2.55297},                               2.6e-15, {0.58707119397394181, 0.11245196213651897,   2.1380801233261493}},
    {45 * degree, 50, {0.548150, 0.0825328, 1.86288},                               2.8e-15, {0.59139687474802605, 0.076119227601541453,  2.9415074482598342}},
    {60 * degree, 80, {0.386939, 0.0555961, 1.84706},                               5.9e-15, {0.35947699571943448, 0.054798602738911351,  2.2757961603433912}},
}};
// clang-format on

// z(v) = scale (1 + sin(iv - gamma)) and z'(v) = scale i cos(iv - gamma) at v = p spacing, p = 0..P; the weights
// include the conjugate half.
Contour hyperbola(Index P, const HyperbolaShape& shape, double t0) {
  const double scale = shape.mu / t0;
  Contour contour;
  contour.nodes.resize(P + 1);
  contour.weights.resize(P + 1);
  const Complex i(0, 1);
  for (Index p = 0; p <= P; ++p) {
    const Complex angle(-shape.gamma, double(p) * shape.spacing);
    contour.nodes[p] = scale * (1.0 + std::sin(angle));
    const Complex c = shape.spacing / (2 * std::numbers::pi * i) * scale * i * std::cos(angle);
    contour.weights[p] = p == 0 ? c : 2.0 * c;
  }
  return contour;
}

}  // namespace

std::optional<ContourParameters> contour_parameters(double half_angle, double tolerance) {
  for (const ContourParameters& entry : parameter_table)
    if (half_angle <= entry.half_angle && entry.error <= tolerance) return entry;
  return std::nullopt;
}

Contour window_contour(const ContourParameters& parameters, double t0) {
  Contour contour = hyperbola(parameters.P, parameters.window, t0);
  contour.t0 = t0;
  contour.t1 = window_ratio * t0;
  return contour;
}

Contour near_contour(const ContourParameters& parameters, double h) {
  Contour contour = hyperbola(parameters.P, parameters.near, h);
  contour.t0 = h;
  contour.t1 = 2 * h;
  return contour;
}

std::optional<Contour> circle(double rho, double h) {
  constexpr Index points = 128;
  if (!(h * rho <= 9)) return std::nullopt;
  const double radius = std::max(2 * rho, rho + 3 / h);
  Contour contour;
  contour.t1 = 2 * h;
  contour.nodes.resize(points / 2);
  contour.weights.resize(points / 2);
  for (Index p = 0; p < points / 2; ++p) {
    contour.nodes[p] = std::polar(radius, 2 * std::numbers::pi * (double(p) + 0.5) / double(points));
    contour.weights[p] = 2.0 / double(points) * contour.nodes[p];
  }
  return contour;
}

Contour literal_contour(Index P, double t) {
  const double root = std::sqrt(double(P));
  Contour contour = hyperbola(P, {0.794, 2.0603 / root, root / 4}, t);
  contour.t0 = contour.t1 = t;
  return contour;
}

}  // namespace bromwich
