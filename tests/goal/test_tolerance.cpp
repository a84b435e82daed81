// Quantities of interest to a tolerance: what is called solved is within it.

#include "core/goal/goal.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include <cmath>
#include <complex>
#include <memory>
#include <utility>

namespace bromwich {
namespace {

constexpr double T = 3;

PortHamiltonian oscillator(TimeFunction u) {
  PortHamiltonian port;
  port.J = SparseMatrix(Matrix{{0, -5}, {5, 0}}.sparseView());
  port.R = SparseMatrix(Matrix{{0.1, 0}, {0, 0.1}}.sparseView());
  port.B = SparseMatrix(Matrix{{1}, {0}}.sparseView());
  port.u = std::move(u);
  return port;
}

// By method goal to the tolerance.
double found_quantity(const Scene& scene, const QuadraticQuantity& quantity, StepScheme scheme, double tolerance) {
  GoalOptions goal;
  goal.scheme = scheme;
  goal.quantity = quadratic_quantity(quantity, scene.states());
  Options options;
  options.method = Method::goal;
  options.tolerance = tolerance;
  options.goal = std::make_shared<GoalOptions>(goal);
  const Result r = run(scene, options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  return r.goal->history.back().quantity;
}

// x_0(T) from rest.
double found_end(TimeFunction u, StepScheme scheme, double tolerance) {
  QuadraticQuantity quantity;
  quantity.end_c = Vector{{1, 0}};
  return found_quantity(make_scene(oscillator(std::move(u)), Vector::Zero(2), T), quantity, scheme, tolerance);
}

// x_0 = Re x of x' = (-1/10 + 5i) x + u: (e^{a (T - from)} - e^{a (T - to)}) / a for u = 1 on (from, to).
double end_of_pulse(double from, double to) {
  const std::complex<double> a(-0.1, 5);
  return ((std::exp(a * (T - from)) - std::exp(a * (T - to))) / a).real();
}

// The sum of indicators of both signs is small by chance, 500 times below the error of 161 cells for the second one;
// and cells whose indicators vanish are never halved.
TEST(GoalTolerance, IsKeptWhereIndicatorsCancel) {
  for (const double omega : {59.0, 77.0}) {
    const std::complex<double> a(-0.1, 5), i(0, 1);
    const auto part = [&](double sign) {
      const std::complex<double> b = sign * i * omega;
      return (std::exp(b * T) - std::exp(a * T)) / (b - a);
    };
    const double exact = ((part(1) - part(-1)) / (2.0 * i)).real();
    const auto u = [omega](double t, Eigen::Ref<Vector> value) { value[0] = std::sin(omega * t); };
    EXPECT_NEAR(found_end(u, StepScheme::euler, 3e-5), exact, 3e-5) << omega;
  }
}

// Pulses between the cells of the first grid, and between 1000 samples; of size 1 in x(T).
TEST(GoalTolerance, IsKeptWithShortPulses) {
  for (const StepScheme scheme : {StepScheme::euler, StepScheme::midpoint, StepScheme::exponential})
    for (const double width : {4e-4, 4e-3}) {
      const double from = 0.771, to = from + width;
      const auto u = [=](double t, Eigen::Ref<Vector> value) { value[0] = t >= from && t < to ? 1 / width : 0; };
      EXPECT_NEAR(found_end(u, scheme, 1e-3), end_of_pulse(from, to) / width, 1e-3) << width;
    }
}

// x = e^-t with weights c(t) that only a quadrature sees: sin(60 t), and pulses of 3/1000 every 1/100.
TEST(GoalTolerance, IsKeptWithWeightsThatVary) {
  PortHamiltonian port;
  port.J = SparseMatrix(1, 1);
  port.R = SparseMatrix(Matrix{{1}}.sparseView());
  QuadraticQuantity sine, pulses;
  sine.c = [](double t, Eigen::Ref<Vector> c) { c[0] = std::sin(60 * t); };
  pulses.c = [](double t, Eigen::Ref<Vector> c) { c[0] = 100 * t - std::floor(100 * t) < 0.3 ? 1 : 0; };
  const std::complex<double> b(-1, 60);
  double of_pulses = 0;
  for (int k = 0; k < 300; ++k) {
    pulses.breakpoints.insert(pulses.breakpoints.end(), {k / 100.0, (k + 0.3) / 100});
    of_pulses += std::exp(-k / 100.0) - std::exp(-(k + 0.3) / 100);
  }
  const Scene scene = make_scene(port, Vector{{1}}, T);
  for (const StepScheme scheme : {StepScheme::euler, StepScheme::midpoint, StepScheme::exponential}) {
    EXPECT_NEAR(found_quantity(scene, sine, scheme, 1e-4), ((std::exp(b * T) - 1.0) / b).imag(), 1e-4);
    EXPECT_NEAR(found_quantity(scene, pulses, scheme, 1e-3), of_pulses, 1e-3);
  }
}

}  // namespace
}  // namespace bromwich
