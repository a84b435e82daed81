#include "core/numerics/literal_contour.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

constexpr double pi = std::numbers::pi;

// t = 1: z(v) = shift + mu (1 + sin(iv - gamma)).
struct Choice {
  double shift = 0;
  HyperbolaShape shape{};
  double error = INFINITY;  ///< expected
};

// Re(iv - gamma) at the eigenvalues: inside the hyperbola where it is below -gamma.
Eigen::ArrayXd across(const ComplexVector& lambda, double shift, double mu) {
  Eigen::ArrayXd values(lambda.size());
  for (Index i = 0; i < lambda.size(); ++i) values[i] = std::asin((lambda[i] - shift) / mu - 1.0).real();
  return values;
}

// What the nodes, the growth of e^z to the right and the eigenvalues at distance `apart` let expect.
double expected_error(Index P, double shift, const HyperbolaShape& s, const Eigen::ArrayXd& apart,
                      const Eigen::ArrayXd& growth) {
  const double left_out = 2 / s.mu * std::exp(-double(P) * s.spacing);
  const double right = std::exp(std::max(shift, 0.0) + s.mu - 2 * pi * s.gamma / s.spacing);
  return std::max({left_out, right, (growth * (-2 * pi / s.spacing * apart).exp()).maxCoeff()});
}

Choice best_hyperbola(const ComplexVector& lambda, Index P) {
  Choice best;
  for (const double shift : {0., -4., -2., 1., 2., 4.})
    for (const double width : {0.25, 0.06, 0.12, 0.5}) {
      const double mu = width * std::sqrt(double(P));
      const Eigen::ArrayXd at = across(lambda, shift, mu);
      for (double gamma = 0.15; gamma < 1.3; gamma += 0.05) {
        const Eigen::ArrayXd apart = (at + gamma).abs();
        const Eigen::ArrayXd growth = (at < -gamma).select(std::max(shift, 0.0), lambda.array().real().max(0.0)).exp();
        const double d = std::min({apart.minCoeff(), gamma, pi / 2 - gamma});
        for (const double part : {0.7, 0.85, 1.0, 1.2}) {
          const HyperbolaShape shape{gamma, part * std::sqrt(2 * pi * d / double(P)), mu};
          const double error = d > 0 ? expected_error(P, shift, shape, apart, growth) : INFINITY;
          if (error < best.error) best = {shift, shape, error};
        }
      }
    }
  return best;
}

struct Circle {
  Complex center;
  double radius;
};

constexpr double linked = 0.2;  ///< eigenvalues at most so far apart share a circle; in units of 1/t, as all here

// Groups of eigenvalues by their distances, and a circle of radius 1 or less around each, clear of all others.
std::vector<Circle> circles_around(std::vector<Complex> outside, const ComplexVector& all) {
  std::vector<Circle> circles;
  while (!outside.empty()) {
    std::vector<Complex> group{outside.back()};
    outside.pop_back();
    for (std::size_t next = 0; next < group.size(); ++next) {
      const auto near =
          std::partition(outside.begin(), outside.end(), [&](Complex z) { return std::abs(z - group[next]) > linked; });
      group.insert(group.end(), near, outside.end());
      outside.erase(near, outside.end());
    }
    Complex center = 0;
    for (const Complex z : group) center += z / double(group.size());
    double spread = 0, gap = INFINITY;
    for (const Complex z : group) spread = std::max(spread, std::abs(z - center));
    for (const Complex z : all)
      if (std::find(group.begin(), group.end(), z) == group.end()) gap = std::min(gap, std::abs(z - center));
    if (center.imag() < -epsilon * (1 + std::abs(center))) continue;  // the conjugate of another one
    circles.push_back({center, std::max(std::min(1.0, gap / 2), std::min(2 * spread, (spread + gap) / 2))});
  }
  return circles;
}

// The trapezoidal rule; on the real axis the upper half, which counts twice.
void add_circle(const Circle& circle, Index P, Contour& contour) {
  const bool real = circle.center.imag() <= epsilon * (1 + std::abs(circle.center));
  const Index first = contour.nodes.size(), count = real ? P : 2 * P;
  contour.nodes.conservativeResize(first + count);
  contour.weights.conservativeResize(first + count);
  for (Index k = 0; k < count; ++k) {
    const Complex turn = std::polar(circle.radius, pi * (double(k) + 0.5) / double(P));
    contour.nodes[first + k] = (real ? circle.center.real() : circle.center) + turn;
    contour.weights[first + k] = turn / double(P);
  }
}

}  // namespace

ContourParameters initial_value_parameters(Index P) {
  const HyperbolaShape shape{1.1721, 1.0818 / double(P), 4.4921 * double(P)};
  return {0, P, shape, std::exp(-2.32 * double(P)), shape};
}

Contour contour_around(const ComplexVector& eigenvalues, Index P, double t) {
  const ComplexVector lambda = t * eigenvalues;
  const Choice choice = best_hyperbola(lambda, P);
  Contour contour = window_contour({0, P, choice.shape, choice.error, choice.shape}, 1);
  contour.nodes.array() += choice.shift;
  const Eigen::ArrayXd at = across(lambda, choice.shift, choice.shape.mu);
  std::vector<Complex> outside;
  for (Index i = 0; i < lambda.size(); ++i)
    if (!(at[i] < -choice.shape.gamma)) outside.push_back(lambda[i]);
  for (const Circle& circle : circles_around(outside, lambda)) add_circle(circle, P, contour);
  contour.nodes /= t;
  contour.weights /= t;
  contour.t0 = contour.t1 = t;
  return contour;
}

}  // namespace bromwich
