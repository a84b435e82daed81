// Small signals about periodic states, against closed forms: linear circuits, an averaged model that is exact at low
// frequencies, and a sampled one.

#include "circuits/small_signal.hpp"
#include "core/base/error.hpp"
#include "tests/circuits/circuits.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace bromwich {
namespace small_signal_test {

constexpr double pi = std::numbers::pi;
using Complex = std::complex<double>;

Eigen::MatrixXcd response(const std::string& cards, const std::string& source, const std::vector<double>& frequencies,
                          const std::vector<std::string>& outputs) {
  const Circuit c = parse_circuit("t\n" + cards, "test.cir", {}, {}, 0);
  const auto backend = make_cpu_backend(1);
  const Result r = test::periodic_state(c, *backend);
  std::vector<Probe> probes;
  for (const std::string& text : outputs) probes.emplace_back(c, text, "test");
  return small_signals(c, *backend, r, source, frequencies, probes, "test");
}

void expect_near(Complex found, Complex known, double tolerance) {
  EXPECT_LT(std::abs(found - known), tolerance * std::abs(known)) << found << " against " << known;
}

// A low pass of R, L and C beside a square wave: nothing switches, so it is that of the linear circuit.
TEST(SmallSignals, OfALinearCircuit) {
  const std::vector<double> f{100, 1e3, 5e3, 33e3};
  const auto found =
      response("V1 a 0 PULSE(-5 5 0 0 0 50u 100u)\nR1 a b 2\nL1 b c 1m\nC1 c 0 1u\nR2 c 0 100\n.tran 1u 100u\n", "V1",
               f, {"V(c)", "I(L1)"});
  for (std::size_t k = 0; k < f.size(); ++k) {
    const Complex s(0, 2 * pi * f[k]), load = 1.0 / (1.0 / 100 + s * 1e-6), all = 2.0 + s * 1e-3 + load;
    expect_near(found(Index(k), 0), load / all, 1e-6);
    expect_near(found(Index(k), 1), 1.0 / all, 1e-6);
  }
}

const std::string buck =
    "Vin in 0 20\nS1 in sw p 0 SI\nD1 0 sw DI\nL1 sw out 100u\nC1 out 0 100u\nR1 out 0 5\n"
    ".model SI SW(Ron=1u Roff=1Meg Vt=.5)\n.model DI D(Ron=1u Roff=1Meg Vfwd=0)\n.tran 1u 10u\n";

// The switch node has 20 V for a reference of 1 V, the duty 0.4 for 1 V of the input, at any frequency: its pulses end
// where the reference is. Behind it is a linear filter, which is seen from the load too.
TEST(SmallSignals, OfABuckInContinuousConduction) {
  const std::string modulator = "Vr r 0 0.4\nVt t 0 PULSE(0 1 0 10u 0 0 10u)\nB1 p 0 V=u(V(r)-V(t))\nIz 0 out 0\n";
  const std::vector<double> f{50, 500, 2e3};
  const auto of_reference = response(modulator + buck, "Vr", f, {"V(out)"});
  const auto of_input = response(modulator + buck, "Vin", f, {"V(out)"});
  const auto of_load = response(modulator + buck, "Iz", f, {"V(out)"});
  for (std::size_t k = 0; k < f.size(); ++k) {
    const Complex s(0, 2 * pi * f[k]), filter = 1.0 / (1.0 + s * 100e-6 / 5.0 + s * s * 1e-8);
    expect_near(of_reference(Index(k), 0), 20.0 * filter, 1e-4);
    expect_near(of_input(Index(k), 0), 0.4 * filter, 1e-4);
    expect_near(of_load(Index(k), 0), s * 100e-6 * filter, 1e-4);
  }
}

// Peak current control between ideal voltages: a step of the level answers with the multiplier -m2/m1 a period later.
TEST(SmallSignals, OfPeakCurrentControl) {
  const double T = 10e-6, m1 = 7.0 / 10e-6, m2 = 5.0 / 10e-6;
  const std::vector<double> f{1e3, 20e3, 45e3};
  const auto found = response(
      "Vin in 0 12\nS1 in sw ctl 0 SP\nD1 0 sw DI\nL1 sw out 10u\nVout out 0 5\nVl level 0 4\n"
      "Vc clock 0 PULSE(0 20 0 0 0 0.1u 10u)\nB1 ctl 0 V={V(clock) + V(level) - I(L1)}\n"
      ".model SP SW(Ron=1u Roff=10Meg Vt=8 Vh=8)\n.model DI D(Ron=1u Roff=10Meg)\n.tran 0.1u 10u\n",
      "Vl", f, {"I(L1)"});
  // At the peak, t0 behind the clock, the time moves by dt = (dl - di)/m1; behind it i is off by (m1 + m2) dt + di.
  const double t0 = m2 * T / (m1 + m2), lambda = -m2 / m1;
  for (std::size_t k = 0; k < f.size(); ++k) {
    const Complex s(0, 2 * pi * f[k]), z = std::exp(s * T), at_peak = std::exp(s * t0);
    const double gain = (m1 + m2) / m1;
    // i(0) of each period: i+ = lambda i + gain dl at the peak
    const Complex start = gain * at_peak / (z - lambda);
    const Complex behind = lambda * start + gain * at_peak;
    const Complex integral = (start * (1.0 - std::exp(-s * t0)) + behind * (std::exp(-s * t0) - std::exp(-s * T))) / s;
    expect_near(found(Index(k), 0), integral / T, 1e-4);
  }
}

TEST(SmallSignals, MistakesAreNamed) {
  const std::string cards = "V1 a 0 PULSE(0 1 0 0 0 5u 10u)\nR1 a b 1\nC1 b 0 1u\n.tran 1u 10u\n";
  EXPECT_THROW(response(cards, "V9", {1}, {"V(b)"}), Error);
  EXPECT_THROW(response(cards, "R1", {1}, {"V(b)"}), Error);
  EXPECT_THROW(response(cards, "V1", {0}, {"V(b)"}), Error);
  const Circuit c = parse_circuit("t\n" + cards, "test.cir");
  const auto backend = make_cpu_backend(1);
  Options options;
  options.states = StateSelection::all;
  const Result r = solve(c.scene, *backend, options);
  EXPECT_THROW(small_signals(c, *backend, r, "V1", {1}, {Probe(c, "V(b)", "test")}, "test"), Error);
}

}  // namespace small_signal_test
}  // namespace bromwich
