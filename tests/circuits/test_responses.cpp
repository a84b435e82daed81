// Words of responses against closed forms of linear circuits, margins against a loop of known poles, and sources with a
// small sine beside a large level.

#include "circuits/analysis.hpp"
#include "circuits/responses.hpp"
#include "core/base/error.hpp"
#include "core/result/located_solution.hpp"
#include "tests/circuits/circuits.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace bromwich {
namespace responses_test {

constexpr double pi = std::numbers::pi;

Responses found(const std::string& cards, const std::vector<std::string>& words, const std::string& source,
                const std::vector<double>& frequencies) {
  const Circuit c = parse_circuit("t\n" + cards, "test.cir", {}, {}, 0);
  const auto backend = make_cpu_backend(1);
  const Result r = test::periodic_state(c, *backend);
  return responses(c, *backend, r, words, source, frequencies.empty() ? c.netlist->frequencies : frequencies, "test");
}

// Integrations are off by 1e-12 at most; their central differences have steps of 1e-5.
constexpr double linear = 1e-6;

void expect_near(Complex value, Complex known) {
  EXPECT_LT(std::abs(value - known), linear * std::abs(known)) << value << " against " << known;
}

const std::string network = "R1 a b 2\nL1 b c 1m\nC1 c 0 1u\nR2 c 0 100\n.ac dec 2 100 10k\n";

// About a square wave, and about rest, where the period is free: sources with AC of any size and phase.
TEST(Responses, OfLinearNetworks) {
  for (const std::string source : {"PULSE(-5 5 0 0 0 50u 100u) AC 2 90\n.tran 1u 1m\n", "0 AC 2 90\n"}) {
    const Responses r =
        found("V1 a 0 " + source + network, {"V(c)", "I(L1)", "impedance(c)", "impedance(b,c)"}, "", {});
    ASSERT_EQ(r.frequencies.size(), 5u);
    EXPECT_EQ(r.units, (std::vector<std::string>{"V", "A", "ohm", "ohm"}));
    for (std::size_t k = 0; k < r.frequencies.size(); ++k) {
      EXPECT_NEAR(r.frequencies[k], 100 * std::pow(10, double(k) / 2), 1e-9 * r.frequencies[k]);
      const Complex s(0, 2 * pi * r.frequencies[k]), load = 1.0 / (1.0 / 100 + s * 1e-6), coil = s * 1e-3,
                                                     line = 2.0 + coil;
      const Complex ac(0, 2);  // of the magnitude 2 and the phase 90
      const auto row = r.values.row(Index(k));
      expect_near(row[0], ac * load / (line + load));
      expect_near(row[1], ac / (line + load));
      expect_near(row[2], 1.0 / (1.0 / line + 1.0 / load));
      expect_near(row[3], 1.0 / (1.0 / coil + 1.0 / (2.0 + load)));
    }
  }
  const Responses one = found("V1 a 0 3\n" + network, {"I(L1)"}, "v1", {500});
  EXPECT_EQ(one.units[0], "S");
}

TEST(Responses, MistakesAreNamed) {
  for (const char* word : {"gain(V1)", "gain(R1)", "V(z)", "impedance(z)", "impedance(a,b,c)", "V(c)"})
    EXPECT_THROW(found("V1 a 0 3\n" + network, {word}, "", {500}), Error) << word;
  EXPECT_THROW(found("V1 a 0 3\n" + network, {"V(c)"}, "R1", {500}), Error);
}

TEST(Responses, FrequenciesAreThoseOfSpice) {
  const auto of = [](const char* kind, std::vector<double> n) { return circuits::frequencies_of(kind, n, "test"); };
  EXPECT_EQ(of("lin", {3, 10, 30}), (std::vector<double>{10, 20, 30}));
  EXPECT_EQ(of("lin", {1, 10, 30}), (std::vector<double>{10}));
  EXPECT_EQ(of("list", {5, 3}), (std::vector<double>{5, 3}));
  EXPECT_EQ(of("oct", {1, 10, 80}).size(), 4u);
  EXPECT_EQ(of("dec", {20, 100, 100e3}).size(), 61u);
  for (const auto& [kind, n] : std::vector<std::pair<const char*, std::vector<double>>>{{"dec", {0, 1, 2}},
                                                                                        {"dec", {5, 2, 1}},
                                                                                        {"dec", {5, 0, 1}},
                                                                                        {"dec", {1}},
                                                                                        {"list", {}},
                                                                                        {"list", {-1}},
                                                                                        {"x", {1, 1, 2}}})
    EXPECT_THROW(of(kind, n), Error) << kind;
}

// K/(1 + s tau)^3 has the size 1 at tau w = sqrt(K^(2/3) - 1) and the phase -180 at tau w = sqrt(3), where it is K/8.
TEST(Responses, MarginsOfThreePoles) {
  const double K = 4, tau = 1e-3;
  const std::vector<double> f = circuits::frequencies_of("dec", {400, 1, 10e3}, "test");
  ComplexVector gain(Index(f.size()));
  for (std::size_t k = 0; k < f.size(); ++k) gain[Index(k)] = K / std::pow(1.0 + Complex(0, 2 * pi * f[k] * tau), 3);
  const StabilityMargins m = stability_margins(f, gain);
  const double w = std::sqrt(std::pow(K, 2.0 / 3) - 1);
  constexpr double between = 1e-4;  // lines between points: the square of their distance, 0.006 in log f
  EXPECT_NEAR(m.crossover, w / (2 * pi * tau), between * m.crossover);
  EXPECT_NEAR(m.phase, 180 - 3 * std::atan(w) * 180 / pi, 180 * between);
  EXPECT_NEAR(m.phase_crossover, std::sqrt(3) / (2 * pi * tau), between * m.phase_crossover);
  EXPECT_NEAR(m.gain, 20 * std::log10(8 / K), 20 * between);
  const Vector phase = unwrapped_phase(gain);
  EXPECT_NEAR(phase[phase.size() - 1], -3 * std::atan(2 * pi * f.back() * tau) * 180 / pi, 1e-9);
  const StabilityMargins none = stability_margins({1, 2}, ComplexVector::Constant(2, Complex(0.5, 0)));
  EXPECT_TRUE(std::isnan(none.crossover) && std::isnan(none.phase_crossover));
}

// A comparator of a level and a sawtooth, in whose condition the input of 24 V cancels but for its sine: the steps are
// those without the sine, some more for its bend.
TEST(Responses, SmallSinesTakeNoMoreSteps) {
  const auto steps = [](const std::string& input) {
    const Circuit c = parse_circuit(
        "t\nVin in 0 " + input +
            "\nE1 e 0 in 0 0.1\nVm m e -2.4\nRm m c 1k\nCm c 0 1n\nVs saw 0 PULSE(0 1 0 9.98u 10n 10n 10u)\n"
            "B1 p 0 V={u(V(m) + V(c) - V(saw) + 0.4)}\nS1 in sw p 0 SI\nD1 0 sw DI\nL1 sw out 47u\nC1 out 0 100u\nR1 "
            "out 0 4\n"
            ".model SI SW(Ron=20m Roff=1Meg Vt=.5)\n.model DI D(Ron=15m Roff=1Meg Vfwd=0.45)\n.tran 1u 30u uic\n",
        "test.cir");
    const auto backend = make_cpu_backend(1);
    Options options;
    options.method = Method::events;
    options.steps = 16;
    options.states = StateSelection::all;
    const Result r = solve(c.scene, *backend, options);
    EXPECT_EQ(r.status, Status::solved) << r.reason;
    return r.located ? r.located->pieces.size() : std::size_t(0);
  };
  EXPECT_LT(steps("SIN(24 2.4e-8 1k)"), 10 * steps("SIN(24 2.4 1k)"));
}

}  // namespace responses_test
}  // namespace bromwich
