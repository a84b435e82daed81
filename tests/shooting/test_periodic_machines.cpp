// Periodic states of machines whose dynamics alone leave some states open (ideal capacitors and coils, a tank without
// an outlet), beside transients of the oracle that have settled: mode by mode, period after period.

#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/oracle_events.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

using reference::pi;

/// f = f(t), g = g(t) with period 1; `breaks`: their jumps and kinks inside of it.
struct Machine {
  DenseDynamics d;
  Matrix M;
  TimeFunction f, g;
  std::vector<double> breaks;

  Scene scene() const {
    Scene s;
    const Index m = d.A.rows();
    s.dynamics = d, s.M = M, s.f = f, s.g = g, s.breakpoints = breaks;
    s.lcp_class = LcpClass::PSD, s.breakpoints_are_all = true;
    s.boundary = BoundaryCondition{Matrix::Identity(m, m), -Matrix::Identity(m, m), Vector::Zero(m)};
    s.T = 1, s.default_steps = 100;
    return s;
  }
};

// From `start` until a period changes x by less than 1e-10 of its largest value: with a multiplier below 0.9 the rest
// of the way is below 1e-9 of it.
Vector settled(const Machine& machine, const Vector& start) {
  oracle::EventScene e;
  const auto or_zero = [](const TimeFunction& source) {
    return source ? source : TimeFunction([](double, Eigen::Ref<Vector> v) { v.setZero(); });
  };
  e.scene = {machine.d.A,        machine.d.B,        machine.d.N, machine.M, LcpClass::PSD,
             or_zero(machine.f), or_zero(machine.g), start,       1};
  e.breaks = machine.breaks;
  e.longest_step = 0.1;
  double before = INFINITY;
  for (int period = 0; period < 400; ++period) {
    const oracle::EventSolution s = oracle::locate_events(e);
    EXPECT_TRUE(s.decided) << s.reason << " in period " << period;
    if (!s.decided) return {};
    const Vector end = s.x(1, true);
    const double moved = (end - e.scene.x0).cwiseAbs().maxCoeff() / s.largest_x().maxCoeff();
    e.scene.x0 = end;
    if (moved <= 1e-10) {
      EXPECT_LT(moved, 0.9 * before);
      return end;
    }
    before = moved;
  }
  ADD_FAILURE() << "does not settle";
  return {};
}

// The oracle errs by 1e-9 (above), shooting by 1e-10 times (1 - multiplier)^{-1} <= 10: 1e-8 has room for both.
void expect_the_settled_state(const Machine& machine, const Vector& start) {
  const Vector known = settled(machine, start);
  ASSERT_EQ(known.size(), start.size());
  Options options;
  options.states = StateSelection::all;
  const Result r = solve(machine.scene(), *make_cpu_backend(1), options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.method, Method::shooting);
  for (const auto& y : r.y.colwise()) EXPECT_TRUE((y.array() > 0).any() && (y.array() <= 0).any()) << "it switches";
  EXPECT_LT((r.start - known).cwiseAbs().maxCoeff(), 1e-8 * r.x.cwiseAbs().maxCoeff())
      << r.start.transpose() << " | " << known.transpose();
}

// Two stages of a Cockcroft-Walton multiplier: node a_k = u + v_1 + v_3, node b_k = v_2 + v_4, diodes of 0.1 ohm from
// 0 to a_1, a_1 to b_1, b_1 to a_2, a_2 to b_2. Its capacitors have no other path than the diodes.
TEST(PeriodicMachines, CockcroftWalton) {
  constexpr double C = 1, R = 4, on = 0.1;
  const Matrix N{{1, 0, 0, 0}, {-1, 1, 0, 0}, {1, -1, 1, 0}, {-1, 1, -1, 1}};
  const Matrix load{{0, 0, 0, 0}, {0, 1, 0, 1}, {0, 0, 0, 0}, {0, 1, 0, 1}};
  Machine m{{-load / (R * C), N.transpose() / C, N}, on * Matrix::Identity(4, 4), {}, {}, {}};
  m.g = [](double t, Eigen::Ref<Vector> g) { g = std::sin(2 * pi * t) * Vector{{1, -1, 1, -1}}; };
  expect_the_settled_state(m, Vector::Zero(4));
}

// A Dickson pump: nodes n_1 = phi + v_1, n_2 = 1 - phi + v_2 and the output v_3, phi a clock; diodes from a source of 1
// to n_1, to n_2, to the output.
TEST(PeriodicMachines, DicksonPump) {
  constexpr double C = 1, R = 6, on = 0.1;
  const Matrix N{{1, 0, 0}, {-1, 1, 0}, {0, -1, 1}};
  Matrix A = Matrix::Zero(3, 3);
  A(2, 2) = -1 / (R * C);
  Machine m{{A, N.transpose() / C, N}, on * Matrix::Identity(3, 3), {}, {}, {0.5}};
  m.g = [](double t, Eigen::Ref<Vector> g) {
    const double phi = t < 0.5 ? 0 : 1;
    g << phi - 1, 1 - 2 * phi, phi - 1;
  };
  expect_the_settled_state(m, Vector::Zero(3));
}

// Six ideal diodes behind ideal coils, a floating star, C and R: x = (i_a, i_b, v), y = (currents of the upper diodes,
// voltages s of the lower ones). L i_k' = u_k - s_k - their mean.
TEST(PeriodicMachines, SixPulseRectifier) {
  constexpr double L = 0.05, C = 0.2, R = 3;
  const Matrix I = Matrix::Identity(3, 3), of_currents{{-1, 0}, {0, -1}, {1, 1}};
  const Matrix of_voltages = (Matrix{{2, -1, -1}, {-1, 2, -1}} / 3) / L;
  Machine m;
  m.d = {Matrix::Zero(3, 3), Matrix::Zero(3, 6), Matrix::Zero(6, 3)};
  m.d.A(2, 2) = -1 / (R * C);
  m.d.B.topRightCorner(2, 3) = -of_voltages;
  m.d.B.block(2, 0, 1, 3).setConstant(1 / C);
  m.d.N.block(0, 2, 3, 1).setOnes();
  m.d.N.block(3, 0, 3, 2) = of_currents;
  m.M = Matrix::Zero(6, 6);
  m.M.topRightCorner(3, 3) = -I;
  m.M.bottomLeftCorner(3, 3) = I;
  m.f = [=](double t, Eigen::Ref<Vector> f) {
    f << of_voltages *
             Vector{{std::sin(2 * pi * t), std::sin(2 * pi * (t - 1 / 3.0)), std::sin(2 * pi * (t + 1 / 3.0))}},
        0;
  };
  expect_the_settled_state(m, Vector::Zero(3));
}

// A tank (level h) that only a check valve empties, and a damped flap on a spring that h lifts off its seat and that
// falls back onto it: x = (h, angle), y = (outflow, force of the seat).
TEST(PeriodicMachines, FlapBehindACheckValve) {
  constexpr double resistance = 0.5, stiffness = 6, lift = 12;
  Machine m;
  m.d = {Matrix{{0, 0}, {lift, -stiffness}}, Matrix{{-1, 0}, {0, 1}}, Matrix{{-1, 0}, {0, 1}}};
  m.M = Matrix{{resistance, 0}, {0, 0}};
  m.f = [](double t, Eigen::Ref<Vector> f) { f << 0.3 - std::sin(2 * pi * t), -7; };
  m.g = [](double t, Eigen::Ref<Vector> g) { g << 0.5 - 0.2 * std::cos(2 * pi * t), 0; };
  expect_the_settled_state(m, Vector{{0.5, 0}});
}

}  // namespace
}  // namespace bromwich
