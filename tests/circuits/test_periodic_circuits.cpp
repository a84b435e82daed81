// Periodic states of circuits, against those of another program, which integrates mode by mode and closes the period,
// and against settled transients by method events.

#include "core/solve/shooting_control.hpp"
#include "tests/circuits/circuits.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>

namespace bromwich {
namespace {

using test::circuit_of;

/// With x(0) = x(T), T the end of .tran.
Circuit periodic(Circuit c) {
  const Index m = c.scene.states();
  c.scene.boundary = BoundaryCondition{Matrix::Identity(m, m), -Matrix::Identity(m, m), Vector::Zero(m)};
  c.scene.x0.resize(0);
  return c;
}

/// Outputs at the end of the period, by method auto.
std::map<std::string, double> periodic_values(const Circuit& c) {
  Options options;
  options.states = StateSelection::all;
  options.steps = 16;
  const auto backend = make_cpu_backend(1);
  const Result r = solve(c.scene, *backend, options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.method, Method::shooting);
  std::map<std::string, double> all;
  if (r.status != Status::solved) return all;
  const RowMatrix rows = output_values(c, r);
  for (std::size_t i = 0; i < c.outputs.size(); ++i) all[c.outputs[i].name] = rows(16, Index(i));
  return all;
}

const char* const periodic_models =
    ".model SI SW(Ron=10m Roff=1Meg Vt=.5 Vh=0)\n.model DI D(Ron=10m Vfwd=.5 Roff=1Meg)\n";

// Values are known to 8 digits.
void expect_values(const std::string& cards, const std::map<std::string, double>& known) {
  const std::map<std::string, double> found = periodic_values(periodic(circuit_of(periodic_models + cards)));
  for (const auto& [name, value] : known) {
    ASSERT_TRUE(found.count(name)) << name;
    EXPECT_NEAR(found.at(name), value, 1e-7 * std::abs(value)) << name;
  }
}

TEST(PeriodicCircuit, Buck) {
  expect_values(
      "Vin in 0 24\nS1 in sw g 0 SB\nVg g 0 PULSE(0 5 0 10n 10n 3.99u 10u)\n.model SB SW(Ron=10m Roff=1Meg Vt=2.5)\n"
      "D1 0 sw DI\nL1 sw out 100u\nC1 out 0 47u\nR1 out 0 5\n.tran 10u 10u uic\n",
      {{"V(out)", 9.2793276}, {"I(L1)", 1.5626621}});
}

// Voltage control without a limit of the amplifier: Newton's first steps wind it up to 250 kV, where periods lead
// nowhere. Values of a transient of 300 periods.
TEST(PeriodicCircuit, BuckWithItsController) {
  expect_values(
      "Vin in 0 24\nS1 in sw pwm 0 SX\nD1 0 sw DX\nL1 sw x 47u\nRl x out 15m\nC1 out y 100u\nResr y 0 20m\nRload out 0 "
      "4\n"
      "R1 out fb 38k\nR3 out b 1.8k\nC3 b fb 1.8n\nR2 fb 0 10k\nE1 c 0 ref fb 1e5\nVref ref 0 2.5\nRc c d 15k\nC2 d fb "
      "6.8n\n"
      "C4 c fb 120p\nVs saw 0 PULSE(0 2.5 0 9.98u 10n 10n 10u)\nB1 pwm 0 V={5*u(V(c) - V(saw))}\n"
      ".model SX SW(Ron=20m Roff=1Meg Vt=2.5)\n.model DX D(Ron=15m Roff=1Meg Vfwd=0.45)\n.tran 10u 10u uic\n",
      {{"V(out)", 11.98723358}, {"I(L1)", 2.35184637}});
}

TEST(PeriodicCircuit, FlybackInDiscontinuousConduction) {
  expect_values(
      "Vin in 0 24\nL1 in sw 100u\nL2 0 sec 6.25u\nK1 L1 L2 1\nS1 sw 0 g 0 SB\nVg g 0 PULSE(0 5 0 10n 10n 7.99u 20u)\n"
      ".model SB SW(Ron=20m Roff=1Meg Vt=2.5)\nD1 sec out DI\nC1 out 0 100u\nR1 out 0 20\n.tran 20u 20u uic\n",
      {{"V(out)", 13.286574}});
}

TEST(PeriodicCircuit, Cuk) {
  expect_values(
      "Vin in 0 10\nL1 in a 180u\nS1 a 0 g 0 SB\nVg g 0 PULSE(0 5 0 10n 10n 8.99u 20u)\n"
      ".model SB SW(Ron=20m Roff=1Meg Vt=2.5)\nC1 a b 47u\nD1 b 0 DI\nL2 b out 150u\nCo out 0 220u\nR1 out 0 3\n"
      ".tran 20u 20u uic\n",
      {{"V(out)", -7.5604368}, {"I(L1)", 1.8133882}});
}

TEST(PeriodicCircuit, SynchronousBuck) {
  expect_values(
      "Vin in 0 12\nS1 in sw g1 0 SS\nS2 sw 0 g2 0 SS\nV1 g1 0 PULSE(0 1 40n 1n 1n 1.42u 5u)\n"
      "V2 g2 0 PULSE(0 1 1.54u 1n 1n 3.42u 5u)\n.model SS SW(Ron=5m Roff=1Meg Vt=.5)\n.model DS D(Ron=5m Vfwd=.8 "
      "Roff=1Meg)\nD1 sw in DS\nD2 0 sw DS\nL1 sw out 4.7u\nC1 out x 100u\nResr x 0 5m\nR1 out 0 .7\n.tran 5u 5u uic\n",
      {{"I(L1)", 3.5350358}});
}

TEST(PeriodicCircuit, SixPulseBridge) {
  std::string cards = ".model D6 D(Ron=10m Vfwd=.8 Roff=1Meg)\n";
  for (int k = 0; k < 3; ++k) {
    const std::string p(1, char('a' + k));
    cards += "V" + p + " " + p + "0 s SIN(0 325 50 0 0 " + std::to_string(-120 * k) + ")\n";
    cards += "L" + p + " " + p + "0 " + p + " 1m\nDu" + p + " " + p + " p D6\nDl" + p + " 0 " + p + " D6\n";
  }
  expect_values(cards + "L1 p q 5m\nC1 q 0 470u\nR1 q 0 30\n.tran 1m 20m uic\n", {{"V(q)", 526.59268}});
}

// Against 40 periods with a multiplier below 0.5: 1e-12.
TEST(PeriodicCircuit, DoublerAgainstASettledTransient) {
  const Circuit c = circuit_of(std::string(periodic_models) +
                               "Va a0 0 SIN(0 100 1k)\nC1 a0 a1 1u\nD1 0 a1 DI\nD2 a1 b1 DI\nC2 0 b1 1u\nRL b1 0 1k\n"
                               ".tran 1m 1m uic\n");
  Scene scene = c.scene;
  scene.x0 = Vector::Zero(scene.states());
  scene.default_steps = 8;
  const auto backend = make_cpu_backend(1);
  Options options = options_for(Method::events);
  options.states = StateSelection::all;
  for (int period = 0; period < 40; ++period) {
    const Result r = solve(scene, *backend, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    scene.x0 = r.x.row(8).transpose();
  }
  options.method = Method::automatic;
  const Result r = solve(periodic(c).scene, *backend, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_LT((r.x.row(0).transpose() - scene.x0).norm(), 1e-8 * scene.x0.norm());
  EXPECT_LT(std::abs(r.multipliers[0]), 0.5);
}

// A boost converter behind a rectified line, an ideal coil with 100 gates in a period of the line; the current stops
// between them where the line is low. x = (i, v), y = (i_d, p, q).
// A boost converter of a rectified line with 100 gates in its period. Its current is 0 at t = 0.
Scene power_factor_correction() {
  constexpr double L = 1e-3, C = 470e-6, R = 160, T = 0.02, gate = T / 100, pi = 3.14159265358979323846;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 0}, {0, -1 / (R * C)}}, Matrix{{0, -1 / L, 1 / L}, {1 / C, 0, 0}},
                                 Matrix{{0, 1}, {-1, 0}, {1, 0}}};
  scene.M = Matrix{{0, -1, 1}, {1, 0, 0}, {-1, 0, 0}};
  scene.lcp_class = LcpClass::PSD;
  scene.f = [](double t, Eigen::Ref<Vector> f) { f << 325 / L * std::abs(std::sin(2 * pi * t / T)), 0; };
  scene.g = [](double t, Eigen::Ref<Vector> g) {
    const double phase = t / gate - std::floor(t / gate);
    g << 0, phase >= 0.25 && phase < 0.5 ? 1000.0 : 0.0, 0;
  };
  for (int k = 0; k < 100; ++k) {
    if (k == 50) scene.breakpoints.push_back(T / 2);
    for (const double part : {0.25, 0.5}) scene.breakpoints.push_back((k + part) * gate);
  }
  scene.breakpoints_are_all = true;
  scene.T = T;
  scene.default_steps = 100;
  scene.x0 = Vector{{0, 400}};
  return scene;
}

// A current that another solve has left as rounding is no current.
TEST(PeriodicCircuit, PowerFactorCorrectionFromRoundingOfItsCurrent) {
  const auto backend = make_cpu_backend(1);
  Scene scene = power_factor_correction();
  const Result expected = solve(scene, *backend, options_for(Method::events));
  for (const double current : {1e-10, 1e-13, 1e-16, 1e-20, -1e-13, -1e-16}) {
    scene.x0[0] = current;
    const Result r = solve(scene, *backend, options_for(Method::events));
    ASSERT_EQ(r.status, Status::solved) << current << " " << r.reason;
    EXPECT_LT((r.y_integral - expected.y_integral).norm(), 1e-8 * expected.y_integral.norm()) << current;
  }
}

TEST(PeriodicCircuit, PowerFactorCorrectionAgainstASettledTransient) {
  Scene scene = power_factor_correction();
  const auto backend = make_cpu_backend(1);
  Options options = options_for(Method::events);
  options.states = StateSelection::all;
  const Scene transient = scene;
  for (int period = 0; period < 8; ++period) {  // the multiplier is 0.017: 1e-14
    const Result r = solve(scene, *backend, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    scene.x0 = r.x.row(100).transpose();
  }
  Scene closed = transient;
  closed.x0.resize(0);
  closed.boundary = BoundaryCondition{Matrix::Identity(2, 2), -Matrix::Identity(2, 2), Vector::Zero(2)};
  options.method = Method::shooting;
  const Result r = solve(closed, *backend, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_LT((r.x.row(0).transpose() - scene.x0).norm(), 1e-8 * scene.x0.norm());
  EXPECT_LT(std::abs(r.multipliers[0]), 0.1);
}

}  // namespace
}  // namespace bromwich
