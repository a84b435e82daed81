// Switches that the state of the circuit controls, and thyristors, against closed forms.

#include "derivatives/parameter_derivative.hpp"
#include "tests/circuits/circuits.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>

namespace bromwich {
namespace memories_test {

using test::circuit_of;
constexpr double pi = std::numbers::pi;

std::map<std::string, double> values(const Circuit& c, double t) { return test::values_at(c, t, 1e-7); }

// 5 V charge 1 uF over 10 kohm; from 3.5 V on the switch discharges it over 1 kohm, down to 1.5 V.
TEST(Memories, AnOscillatorWithAHysteresisSwitch) {
  const Circuit c = circuit_of(
      "V1 in 0 5\nR1 in a 10k\nC1 a 0 1u\nR2 a b 999\nS1 b 0 a 0 SH\n.model SH SW(Ron=1 Roff=10g Vt=2.5 Vh=1)\n"
      ".tran 1m 40m uic\n");
  ASSERT_EQ(c.scene.states(), 1);
  ASSERT_EQ(c.scene.memories.size(), 1u);
  EXPECT_EQ(c.scene.memories[0].name, "S1");
  const double up = 10e-3, down = 1e-6 / (1 / 10e3 + 1 / 1e3), low = 5 * 1e3 / 11e3;
  const double first = up * std::log(5 / 1.5), rise = up * std::log(3.5 / 1.5),
               fall = down * std::log((3.5 - low) / (1.5 - low));
  double t = first;
  while (t + fall + rise < 40e-3) t += fall + rise;
  // at the last start of a discharge, half of it later
  const double v = low + (3.5 - low) * std::exp(-fall / 2 / down);
  EXPECT_NEAR(values(c, t + fall / 2).at("V(a)"), v, 1e-6);
  const double later = t + fall + rise / 3 < 40e-3 ? t + fall + rise / 3 : t - rise / 2;
  EXPECT_NEAR(values(c, later).at("V(a)"), 5 - 3.5 * std::exp(-(later > t ? rise / 3 : rise / 2) / up), 1e-6);
}

// A switch that the current of a source controls, as a latch: below 0.5 A it opens, and nothing closes it again.
TEST(Memories, ACurrentControlledSwitchOpensAFuse) {
  const Circuit c = circuit_of(
      "V1 in 0 10\nVs in b 0\nW1 b c Vs WF ON\nL1 c 0 10m IC=2\nR1 b 0 1k\n.model WF CSW(Ron=2 Roff=10Meg It=-5 "
      "Ih=20)\n"
      ".tran 1m 5m uic\n");
  // never above 15 A nor below -25 A: closed from the begin
  const double i = 5 - 3 * std::exp(-5e-3 * 2 / 10e-3);
  EXPECT_NEAR(values(c, 5e-3).at("I(L1)"), i, 1e-5);  // 10 V over Roff
}

// A switch that the mode of another one controls, and nothing else: it is closed while the other one is open.
TEST(Memories, AModeThatAnotherOneControls) {
  const Circuit c = circuit_of(
      "B1 o 0 V=5-5*schmitt(V(c), 2, 3)\nR1 o c 1k\nC1 c 0 1u IC=2\nB2 p 0 V=7*u(V(o)-2.5)\nR2 p 0 1k\n"
      ".tran 1u 5m uic\n");
  ASSERT_EQ(c.scene.memories.size(), 2u);
  const double way = 1e-3 * std::log(1.5);
  for (int k = 0; k < 4; ++k) EXPECT_NEAR(values(c, (k + 0.5) * way).at("V(p)"), k % 2 == 0 ? 7 : 0, 1e-12) << k;
}

// A step of 10 V behind two capacitors in series, 1 uF and 3 uF: the second one jumps by a quarter of it.
TEST(Memories, ChargeIsKeptWhereAModeChanges) {
  const Circuit c = circuit_of(
      "V1 in 0 5\nR0 in a 1k\nC0 a 0 1u IC=0\nB1 o 0 V=10*schmitt(V(a), 1, 3)\nC1 o q 1u\nC2 q 0 3u\nR2 q 0 1k\n"
      ".tran 1u 5m uic\n");
  const double step = 1e-3 * std::log(5.0 / 2);
  EXPECT_NEAR(values(c, step / 2).at("V(q)"), 0, 1e-9);
  EXPECT_NEAR(values(c, step + 2e-3).at("V(q)"), 2.5 * std::exp(-0.5), 1e-7);
}

// Half a wave over R, fired at the angle a: I(R1) follows from there to the next zero.
TEST(Memories, AThyristorFiresAndStops) {
  const std::string cards =
      "V1 a 0 SIN(0 100 50)\nS1 a b g 0 T1\nR1 b 0 9.999\nVg g 0 PULSE(0 5 {delay} 0 0 0.1m 20m)\n"
      ".model T1 SCR(Ron=1m Roff=1Meg Vfwd=0 Ih=1m)\n.param delay=4m\nC9 x 0 1u\nR9 x 0 1\n.tran 1m 40m uic\n";
  const Circuit c = circuit_of(cards);
  const double leak = 100.0 / 1e6;
  EXPECT_NEAR(values(c, 3.9e-3).at("I(R1)"), 0, leak);
  EXPECT_NEAR(values(c, 6e-3).at("I(R1)"), 10 * std::sin(0.6 * pi), leak);
  EXPECT_NEAR(values(c, 9.9e-3).at("I(R1)"), 10 * std::sin(0.99 * pi), leak);
  EXPECT_NEAR(values(c, 15e-3).at("I(R1)"), 0, leak);
  EXPECT_NEAR(values(c, 23e-3).at("I(R1)"), 0, leak);
  EXPECT_NEAR(values(c, 27e-3).at("I(R1)"), 10 * std::sin(0.7 * pi), leak);
}

// With a coil the current goes on behind the zero of the source:
// i = V/Z (sin(wt - phi) - sin(a - phi) e^{-(wt - a) R / (w L)}).
TEST(Memories, AThyristorBeforeACoil) {
  const double w = 100 * pi, R = 5, L = 20e-3, Z = std::hypot(R, w * L), phi = std::atan2(w * L, R), a = 0.3 * pi;
  const Circuit c = circuit_of(
      "V1 a 0 SIN(0 100 50)\nS1 a b g 0 T1\nL1 b c 20m\nR1 c 0 4.999\nVg g 0 PULSE(0 5 3m 0 0 0.2m 20m)\n"
      ".model T1 SCR(Ron=1m Roff=10k Vfwd=0 Ih=0.1m)\n.tran 1m 20m uic\n");
  const auto i = [&](double t) {
    return 100 / Z * (std::sin(w * t - phi) - std::sin(a - phi) * std::exp(-(w * t - a) * R / (w * L)));
  };
  double low = 10e-3, high = 19e-3;
  for (int k = 0; k < 60; ++k) (i((low + high) / 2) > 0 ? low : high) = (low + high) / 2;
  const double leak = 100.0 / 1e4;
  for (const double t : {4e-3, 8e-3, low - 0.2e-3}) EXPECT_NEAR(values(c, t).at("I(L1)"), i(t), 2 * leak) << t;
  EXPECT_NEAR(values(c, low + 0.2e-3).at("I(L1)"), 0, 2 * leak);
}

// Peak current control of a buck converter: a clock closes the switch, the current of the coil opens it. Between ideal
// voltages i(0) = Ip - m1 m2 T / (m1 + m2).
TEST(Memories, PeakCurrentControlInPeriodicState) {
  const Circuit c = parse_circuit(
      "t\nVin in 0 12\nS1 in sw ctl 0 SP\nD1 0 sw DI\nL1 sw s 10u\nVs s out 0\nVout out 0 5\n"
      "Hs sense 0 Vs 1\nVc clock 0 PULSE(0 10 0 0 0 0.1u 10u)\nE1 ctl 0 clock sense 1\n"
      ".model SP SW(Ron=1u Roff=10Meg Vt=0 Vh=4)\n.model DI D(Ron=1u Roff=10Meg)\n.tran 0.1u 10u uic\n",
      "test.cir", {}, {}, 0);
  Options options;
  options.steps = 16;
  options.states = StateSelection::all;
  const auto backend = make_cpu_backend(1);
  const Result r = solve(c.scene, *backend, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  const double m1 = 7.0 / 10e-6, m2 = 5.0 / 10e-6, i = 4 - m1 * m2 * 10e-6 / (m1 + m2);
  EXPECT_NEAR(r.start[0], i, 1e-5);  // of 4 A over 1 uohm, and 12 V over 10 megohm
  EXPECT_NEAR(r.multipliers[0].real(), -m2 / m1, 1e-5);
}

// Two thyristors on a source of current: one takes it over from the other, and there is no state.
TEST(Memories, ThyristorsOnASourceOfCurrent) {
  const Circuit c = circuit_of(
      "V1 a 0 SIN(0 100 50)\nS1 a b g 0 T1\nS2 0 b g2 0 T1\nI1 b 0 5\nVg g 0 PULSE(0 5 3m 0 0 0.2m 20m)\n"
      "Vg2 g2 0 PULSE(0 5 13m 0 0 0.2m 20m)\n.model T1 SCR(Ron=1m Roff=1Meg Vfwd=0 Ih=1m)\n.tran 1m 40m uic\n");
  ASSERT_EQ(c.scene.memories.size(), 2u);
  const double leak = 100.0 / 1e6;
  EXPECT_NEAR(values(c, 5e-3).at("I(S1)"), 5, leak);
  EXPECT_NEAR(values(c, 5e-3).at("V(b)"), 100 - 5e-3, leak);
  EXPECT_NEAR(values(c, 15e-3).at("I(S2)"), 5, leak);
}

// Derivatives by parameters beside central differences of solves: two integrations to 1e-9 of x over steps of 1e-3 of
// the parameter differ from its derivative by 1e-6 and its square.
void expect_derivatives(const std::string& cards, const std::map<std::string, double>& parameters, double t) {
  const auto with = [&](const std::string& name, double value) {
    return parse_circuit("title\n" + cards, "test.cir", {}, {{name, value}}).scene;
  };
  const auto backend = make_cpu_backend(1);
  Options options;
  options.steps = 50;
  options.states = StateSelection::all;
  const auto at = [&](const Scene& scene) {
    const Result r = solve(scene, *backend, options);
    EXPECT_EQ(r.status, Status::solved) << r.reason;
    return Vector(at_times(scene, *backend, r, {t}).x.row(0).transpose());
  };
  for (const auto& [name, value] : parameters) {
    const std::string of = name;
    const Scene scene = with(of, value);
    const Result r = solve(scene, *backend, options);
    ASSERT_FALSE(r.mode_changes.empty());
    const ParameterDerivative d(scene, r, *backend,
                                {{of, value, [&, of](double v) { return ParameterScene{with(of, v)}; }}}, {}, {t});
    const SolutionChange change = d.jvp(0);
    Index row = 0;
    while (d.times()[row] < t - 1e-12) ++row;
    const double step = 1e-4 * value;
    const Vector known = (at(with(of, value + step)) - at(with(of, value - step))) / (2 * step);
    for (Index i = 0; i < known.size(); ++i)
      EXPECT_NEAR(change.x(row, i), known[i], 1e-5 * known.cwiseAbs().maxCoeff()) << of << ", state " << i;
    SolutionChange weights;
    weights.x = RowMatrix::Zero(d.times().size(), known.size());
    weights.x(row, 0) = 1;
    EXPECT_NEAR(d.vjp(weights)[0], change.x(row, 0), 1e-9 * known.cwiseAbs().maxCoeff());
  }
}

TEST(Memories, DerivativesOfAConverterWithHysteresis) {
  expect_derivatives(
      ".param vin=12 L=10u level=4 Vh=0.5 R=2\nVin in 0 {vin}\nS1 in sw ctl 0 SP\nD1 0 sw DI\nL1 sw out {L}\n"
      "C1 out 0 100u\nR1 out 0 {R}\nB1 ctl 0 V={level - I(L1)}\n.model SP SW(Ron=10m Roff=1k Vt=0 Vh={Vh})\n"
      ".model DI D(Ron=10m Roff=1k Vfwd=0.4)\n.tran 1u 60u uic\n",
      {{"vin", 12}, {"L", 10e-6}, {"level", 4}, {"vh", 0.5}, {"r", 2}}, 47.3e-6);
}

// By the angle at which it fires, too, whose time is a jump of the gate.
TEST(Memories, DerivativesOfAThyristorBeforeACoil) {
  expect_derivatives(
      ".param delay=3m L=20m R=5 amp=100\nV1 a 0 SIN(0 {amp} 50)\nS1 a b g 0 T1\nL1 b c {L}\nR1 c 0 {R}\n"
      "Vg g 0 PULSE(0 5 {delay} 0 0 0.2m 20m)\n.model T1 SCR(Ron=1m Roff=10k Vfwd=0 Ih=0.1m)\n.tran 1m 20m uic\n",
      {{"delay", 3e-3}, {"l", 20e-3}, {"r", 5}, {"amp", 100}}, 8.3e-3);
}

}  // namespace memories_test
}  // namespace bromwich
