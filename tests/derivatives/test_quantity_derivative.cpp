// Quantities of interest and their gradients: closed forms, and central differences of solves.

#include "derivatives/quantity_derivative.hpp"

#include "core/base/error.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

Result all_states(const Scene& scene, Index J) {
  Options options;
  options.steps = J;
  options.method = Method::march;
  options.states = StateSelection::all;
  return solve(scene, *make_cpu_backend(1), options);
}

// x' = -x: ∫ x^2 + x(T) = x0^2 (1 - e^{-2T})/2 + x0 e^{-T}.
TEST(QuantityDerivative, OfDecayIsKnown) {
  Scene s;
  s.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{0}}};
  s.M = Matrix{{1}};
  s.g = [](double, Eigen::Ref<Vector> v) { v[0] = 1; };
  s.x0 = Vector{{2}};
  s.T = 1;
  QuadraticQuantity q;
  q.W = Matrix{{1}}.sparseView();
  q.end_c = Vector{{1}};
  const Index J = 200;
  const SolutionDerivative d(s, all_states(s, J));
  const QuantityChange found = quantity_change(*quadratic_quantity(q, 1), s, d.times(), d.states());
  const double half = (1 - std::exp(-2.0)) / 2, h = 1.0 / J;
  EXPECT_NEAR(found.value, 4 * half + 2 * std::exp(-1.0), h * h);  // lines: h^2/12 max |x''| of each step
  EXPECT_NEAR(d.vjp(found.weights).x0[0], 4 * half + std::exp(-1.0), h * h);
  EXPECT_THROW(quantity_change(*local_balance(), s, d.times(), d.states()), Error);
  EXPECT_THROW(quantity_change(*quadratic_quantity(q, 1), s, d.times(), d.states().topRows(3)), Error);
}

// A circuit with a diode: the gradient of the discrete quantity by all data, against differences of solves.
TEST(QuantityDerivative, AgreesWithDifferences) {
  reference::Random random(17);
  Scene s;
  s.dynamics = DenseDynamics{Matrix{{-0.2, -1}, {1, -0.3}}, Matrix{{1}, {0.5}}, Matrix{{1, 0.4}}};
  s.M = Matrix{{0.5}};
  s.g = [](double t, Eigen::Ref<Vector> v) { v[0] = std::sin(2 * t + 0.3); };
  s.x0 = Vector{{0.7, -0.2}};
  s.T = 4;
  QuadraticQuantity q;
  q.W = Matrix{{1, 0.3}, {0, 2}}.sparseView();
  q.c = TimeFunction([](double t, Eigen::Ref<Vector> v) { v << std::cos(t), 1; });
  q.end_W = Matrix{{0, 1}, {0, 0}}.sparseView();
  q.end_c = Vector{{-1, 2}};
  const auto quantity = quadratic_quantity(q, 2);
  const Index J = 80;
  const SolutionDerivative d(s, all_states(s, J));
  ASSERT_GT(d.margin().margin, 1e-4);
  const auto value = [&](const Scene& scene) {
    const Result r = all_states(scene, J);
    return quantity_change(*quantity, scene, r.t, r.x).value;
  };
  const DataChange gradient = d.vjp(quantity_change(*quantity, s, d.times(), d.states()).weights);
  const double step = 1e-6;  // rounding 1e-14 / step, curvature step^2
  const auto difference = [&](const std::function<void(Scene&, double)>& change) {
    Scene up = s, down = s;
    change(up, step), change(down, -step);
    return (value(up) - value(down)) / (2 * step);
  };
  EXPECT_NEAR(gradient.x0[1], difference([](Scene& o, double by) { o.x0[1] += by; }), 1e-6);
  EXPECT_NEAR(gradient.M(0, 0), difference([](Scene& o, double by) { std::get<Matrix>(o.M)(0, 0) += by; }), 1e-6);
  const Matrix dA = random.matrix(2, 2);
  EXPECT_NEAR(gradient.A.cwiseProduct(dA).sum(), difference([&](Scene& o, double by) {
                DenseDynamics other = *o.dynamics->small_state();
                other.A += by * dA;
                o.dynamics = other;
              }),
              1e-6);
}

// The violation of the energy balance of a port-Hamiltonian scene has a gradient as well.
TEST(QuantityDerivative, OfTheEnergyBalance) {
  PortHamiltonian port;
  port.J = Matrix{{0, 1}, {-1, 0}}.sparseView();
  port.R = Matrix{{0.1, 0}, {0, 0}}.sparseView();
  port.B = Matrix{{0}, {1}}.sparseView();
  port.u = TimeFunction([](double t, Eigen::Ref<Vector> v) { v[0] = std::sin(t); });
  const Index J = 50;
  const auto value = [&](double x0, DataChange* gradient) {
    const Scene s = make_scene(port, Vector{{x0, 0.5}}, 3);  // without constraints
    const Result r = all_states(s, J);
    EXPECT_EQ(r.status, Status::solved) << r.reason;
    const SolutionDerivative d(s, r);
    const QuantityChange found = quantity_change(*local_balance(), s, d.times(), d.states());
    if (gradient) *gradient = d.vjp(found.weights);
    return found.value;
  };
  DataChange gradient;
  const double here = value(1, &gradient), step = 1e-5;
  const double slope = (value(1 + step, nullptr) - value(1 - step, nullptr)) / (2 * step);
  EXPECT_GT(here, 0);
  EXPECT_NEAR(gradient.x0[0], slope, 1e-5 * std::abs(slope) + 1e-10 * here / step);
}

}  // namespace
}  // namespace bromwich
