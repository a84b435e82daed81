// Numbers of results of circuits, against closed forms: .meas cards, harmonics, powers and the balance of energy.

#include "circuits/balance.hpp"
#include "circuits/measures.hpp"
#include "core/result/located_solution.hpp"
#include "tests/circuits/circuits.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <map>
#include <numbers>

namespace bromwich {
namespace {

using test::circuit_of;
constexpr double pi = std::numbers::pi;

struct Solved {
  explicit Solved(Circuit c) : circuit(std::move(c)), backend(make_cpu_backend(1)) {
    Options options;
    if (!circuit.scene.boundary) options.tolerance_x = 1e-9;
    options.states = StateSelection::all;
    if (circuit.scene.boundary) options.steps = 16;
    result = solve(circuit.scene, *backend, options);
    EXPECT_EQ(result.status, Status::solved) << result.reason;
  }
  CircuitWaveforms waveforms(double from, double to) const { return {circuit, *backend, result, from, to, "test"}; }
  Probe probe(const std::string& text) const { return {circuit, text, "test"}; }

  Circuit circuit;
  std::unique_ptr<Backend> backend;
  Result result;
};

std::map<std::string, MeasuredValue> values(const std::string& cards) {
  const Solved s(circuit_of(cards));
  std::map<std::string, MeasuredValue> all;
  for (MeasuredValue& m : measured(s.circuit, *s.backend, s.result)) all.emplace(m.name, m);
  return all;
}

// v = 10 e^{-t/ms}, i = v/k. Quadrature of order 16 in 200 pieces and more, states to 1e-9.
const std::string discharge = "C1 a 0 1u IC=10\nR1 a 0 1k\n.tran 10u 4m uic\n.param level=5\n";

TEST(Measures, CardsAgreeWithClosedForms) {
  const auto m =
      values(discharge +
             ".meas tran mean AVG V(a) FROM=1m TO=3m\n.meas TRAN r RMS V(a)\n.meas least MIN V(a) to=2m\n"
             ".meas most MAX I(R1)\n.meas pp PP V(a)\n.meas heat INTEG V(a)*I(R1)\n"
             ".measure at FIND V(a)*2 AT=1m\n.meas half WHEN V(a)={level}\n"
             ".meas cur FIND I(R1) WHEN V(a)=2.5 FALL=1\n.meas fall TRIG V(a) VAL=9 FALL=1 TARG V(a) VAL=1 FALL=1\n"
             ".meas twice PARAM='2*half + level'\n.meas never WHEN V(a)=5 RISE=1\n"
             ".meas late WHEN V(a)=5 TD=2m\n.meas none FIND V(a) WHEN V(a)=-1\n");
  const double ms = 1e-3, e = std::exp(1);
  const auto near = [&](const char* name, double value, const char* unit) {
    EXPECT_NEAR(m.at(name).value, value, 1e-8 * std::abs(value)) << name;
    EXPECT_EQ(m.at(name).unit, unit) << name;
  };
  near("mean", 10 * (1 / e - std::exp(-3)) / 2, "V");
  near("r", std::sqrt(100 * (1 - std::exp(-8)) / 8), "V");
  near("least", 10 * std::exp(-2), "V");
  near("most", 10e-3, "A");
  near("pp", 10 - 10 * std::exp(-4), "V");
  near("heat", 0.1 * ms * (1 - std::exp(-8)) / 2, "J");
  near("at", 20 / e, "");
  near("half", ms * std::log(2), "s");
  near("cur", 2.5e-3, "A");
  near("fall", ms * std::log(9), "s");
  near("twice", 2 * ms * std::log(2) + 5, "");
  for (const char* name : {"never", "late", "none"}) {
    EXPECT_TRUE(std::isnan(m.at(name).value)) << name;
    EXPECT_NE(m.at(name).found.find("is passed 0 times"), std::string::npos) << m.at(name).found;
  }
}

// Crossings of 1 + 2 sin(2 pi 50 t): up at -1/12 of a period, down at 7/12.
TEST(Measures, CrossingsAreCountedByTheirDirection) {
  const auto m = values(
      "V1 a 0 SIN(1 2 50)\nR1 a 0 1\nC1 b 0 1u\nR2 b 0 1\n.tran 1m 60m uic\n"
      ".meas f2 WHEN V(a)=0 FALL=2\n.meas r1 WHEN V(a)=0 RISE=1\n.meas c3 WHEN V(a)=0 CROSS=3\n"
      ".meas last WHEN V(a)=0 CROSS=LAST\n.meas mean AVG V(a)\n.meas rms RMS V(a)\n.meas most MAX V(a)\n");
  const double T = 20e-3;
  EXPECT_NEAR(m.at("f2").value, T + T * 7 / 12, 1e-10);
  EXPECT_NEAR(m.at("r1").value, T * 11 / 12, 1e-10);
  EXPECT_NEAR(m.at("c3").value, T + T * 7 / 12, 1e-10);
  EXPECT_NEAR(m.at("last").value, 2 * T + T * 11 / 12, 1e-10);
  EXPECT_NEAR(m.at("mean").value, 1, 1e-12);
  EXPECT_NEAR(m.at("rms").value, std::sqrt(3), 1e-12);
  EXPECT_NEAR(m.at("most").value, 3, 1e-9);
}

// Half a sine of amplitude 1 over 1 ohm: mean 1/pi, c_1 = 1/2, c_2 = 2/(3 pi), c_3 = 0, rms 1/2.
TEST(Measures, HarmonicsOfARectifiedSine) {
  const Solved s(
      circuit_of("V1 a 0 SIN(0 1 50)\nD1 a b DI\nR1 b 0 1\nC1 c 0 1u\nR2 c 0 1\n"
                 ".model DI D(Ron=0 Roff=1Meg Vfwd=0)\n.tran 1m 20m uic\n"));
  const CircuitWaveforms w = s.waveforms(0, 20e-3);
  const Probe v = s.probe("V(b)");
  const double off = 1e-6;  // through Roff
  EXPECT_NEAR(w.mean(v), 1 / pi, off);
  const auto c = w.harmonics(v, 3);
  EXPECT_NEAR(std::abs(c[0]), 0.5, off);
  EXPECT_NEAR(std::abs(c[1]), 2 / (3 * pi), off);
  EXPECT_NEAR(std::abs(c[2]), 0, off);
  const OutputNumbers n = numbers(v, w);
  EXPECT_NEAR(n.distortion, std::sqrt((2 * (0.25 - 1 / (pi * pi)) - 0.25) / 0.25), 4 * off);
  EXPECT_NEAR(n.max, 1, 1e-9);
}

// A square wave behind R and C: c_k of the source and of the capacitor, in pieces far longer than a period of c_50.
TEST(Measures, HarmonicsOfASquareWave) {
  const double d = 0.3, tau = 1e-3, T = 1e-3;
  const Solved s(
      parse_circuit("t\nV1 a 0 PULSE(0 1 0 0 0 0.3m 1m)\nR1 a b 1k\nC1 b 0 1u\n.tran 1u 1m\n", "test.cir", {}, {}, 0));
  ASSERT_LT(s.result.located->pieces.size(), 20);
  const CircuitWaveforms w = s.waveforms(0, T);
  const auto of_source = w.harmonics(s.probe("V(a)"), 50), of_C = w.harmonics(s.probe("V(b)"), 50);
  for (int k = 1; k <= 50; ++k) {
    const std::complex<double> i(0, 1), c = (1.0 - std::exp(-2 * pi * d * k * i)) / (pi * k * i);
    EXPECT_LT(std::abs(of_source[std::size_t(k) - 1] - c), 1e-12) << k;
    EXPECT_LT(std::abs(of_C[std::size_t(k) - 1] - c / (1.0 + 2 * pi * k * tau / T * i)), 1e-9) << k;
  }
}

// A source that only a switch sees has kinks between rows: the mean of a triangle up to a third of the period is 1/2.
TEST(Measures, KinksOfSourcesThatOnlyGatesSee) {
  const Solved s(
      circuit_of("Vg g 0 PWL(0 0 0.33333m 1 1m 0)\nV1 a 0 1\nS1 a b g 0 SI\nR1 b 0 1\nC1 b 0 1u\n"
                 ".model SI SW(Ron=1 Roff=1Meg Vt=.5)\n.tran 0.1m 1m uic\n"));
  const CircuitWaveforms w = s.waveforms(0, 1e-3);
  EXPECT_NEAR(w.mean(s.probe("V(g)")), 0.5, 1e-12);
  EXPECT_NEAR(w.rms(s.probe("V(g)")), std::sqrt(1.0 / 3), 1e-12);
}

// 10 V over 1 ohm and 1 mF in series: at the end the source has given C V^2, half of which is stored.
TEST(Measures, BalanceOfACapacitorThatIsCharged) {
  const Solved s(circuit_of("V1 a 0 10\nR1 a b 1\nC1 b 0 1m\n.tran 1m 30m uic\n"));
  const CircuitBalance b = balance(s.circuit, s.waveforms(0, 30e-3));
  EXPECT_NEAR(b.supplied, 0.1, 1e-8);
  EXPECT_NEAR(b.stored, 0.05, 1e-8);
  EXPECT_NEAR(b.dissipated, 0.05, 1e-8);
  EXPECT_LT(b.error, 1e-8);
}

// Coupled coils: the stored energy has the mutual inductance.
TEST(Measures, BalanceOfCoupledCoils) {
  for (const char* k : {"0.6", "1"}) {
    const Solved s(circuit_of(std::string("V1 a 0 SIN(0 1 1k)\nR1 a b 1\nL1 b 0 1m\nL2 c 0 4m\nK1 L1 L2 ") + k +
                              "\nR2 c 0 3\n.tran 10u 1.3m uic\n"));
    const CircuitBalance b = balance(s.circuit, s.waveforms(0, 1.3e-3));
    EXPECT_GT(std::abs(b.stored), 1e-3 * b.supplied) << k;
    EXPECT_LT(b.error, 1e-8) << k;
  }
}

TEST(PeriodicNetlist, PeriodOfTheSourcesAndDelays) {
  const auto periodic = [](const std::string& cards, double period) {
    return parse_circuit("t\n" + cards, "test.cir", {}, {}, period);
  };
  const std::string rest = "R1 a b 1\nR2 g 0 1\nC1 b 0 1u\n.tran 1u 10m\n";
  EXPECT_DOUBLE_EQ(periodic("V1 a 0 SIN(0 1 1k)\nV2 g 0 PULSE(0 1 0 0 0 1u 4u)\n" + rest, 0).scene.T, 1e-3);
  EXPECT_DOUBLE_EQ(periodic("V1 a 0 SIN(0 1 2)\nV2 g 0 SIN(0 1 3)\n" + rest, 0).scene.T, 1);
  EXPECT_DOUBLE_EQ(periodic("V1 a 0 SIN(0 1 1k)\nV2 g 0 5\n" + rest, 2e-3).scene.T, 2e-3);
  const auto message = [&](const std::string& cards, double period) {
    try {
      periodic(cards + rest, period);
      return std::string();
    } catch (const std::exception& e) {
      return std::string(e.what());
    }
  };
  const std::pair<std::string, const char*> mistakes[] = {
      {message("V1 a 0 PWL(0 0 1m 1)\n", 0), "line 2: V1 is not periodic"},
      {message("V1 a 0 5\n", 0), "has no source with a period"},
      {message("V1 a 0 SIN(0 1 1k)\nV2 g 0 SIN(0 1 1414.2135623)\n", 0), "no common period"},
      {message("V1 a 0 SIN(0 1 1k)\n", 1.5e-3), "is no multiple of 0.001 s"}};
  for (const auto& [found, words] : mistakes) EXPECT_NE(found.find(words), std::string::npos) << found;
}

// A delay of whole and broken periods makes no difference but a shift: R C behind a square wave, whose mean is the
// duty.
TEST(PeriodicNetlist, DelaysAreSettled) {
  for (const char* delay : {"0", "0.3m", "7.3m", "0.9m"}) {
    const Solved s(parse_circuit(std::string("t\nV1 a 0 PULSE(0 1 ") + delay +
                                     " 0 0 0.25m 1m)\nR1 a b 1k\nC1 b 0 1u\n.tran 1u 10m\n.meas m AVG V(b)\n",
                                 "test.cir", {}, {}, 0));
    const CircuitWaveforms w = s.waveforms(0, 1e-3);
    EXPECT_NEAR(w.mean(s.probe("V(b)")), 0.25, 1e-9) << delay;
    // tau = T: from low to high in a quarter of a period
    const double q = std::exp(-0.25), p = std::exp(-0.75), high = (1 - q) / (1 - p * q);
    EXPECT_NEAR(w.max(s.probe("V(b)")), high, 1e-7) << delay;
    EXPECT_NEAR(w.min(s.probe("V(b)")), high * p, 1e-7) << delay;
    EXPECT_LT(balance(s.circuit, w).error, 1e-9) << delay;
  }
}

}  // namespace
}  // namespace bromwich
