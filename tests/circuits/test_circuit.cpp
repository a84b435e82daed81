// Circuits against closed forms, and converters against values that another program, which integrates mode by mode,
// gave.

#include "core/solve/dense_output.hpp"
#include "tests/circuits/circuits.hpp"
#include "tests/support/run.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <numbers>
#include <vector>

namespace bromwich {
namespace {

using test::circuit_of;

/// Outputs by name, at the times.
std::vector<std::map<std::string, double>> values(const Circuit& c, const std::vector<double>& times,
                                                  double tol = 1e-6) {
  Options options;
  options.tolerance_x = tol;
  options.states = StateSelection::all;
  const auto backend = make_cpu_backend(1);
  const Result r = solve(c.scene, *backend, options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  const RowMatrix rows = output_values(c, at_times(c.scene, *backend, r, times));
  std::vector<std::map<std::string, double>> all(times.size());
  for (std::size_t j = 0; j < times.size(); ++j)
    for (std::size_t i = 0; i < c.outputs.size(); ++i) all[j][c.outputs[i].name] = rows(Index(j), Index(i));
  return all;
}

// i = V/R (1 - e^{-tR/L}), from zero.
TEST(Circuit, CoilBehindAResistance) {
  const Circuit c = circuit_of("V1 in 0 10\nR1 in a 5\nL1 a 0 10m\n.tran 10m uic\n");
  EXPECT_EQ(c.scene.states(), 1);
  for (const double t : {1e-3, 5e-3}) {
    const double i = 2 * -std::expm1(-t * 500);
    const auto v = values(c, {t})[0];
    EXPECT_NEAR(v.at("I(L1)"), i, 1e-7);
    EXPECT_NEAR(v.at("I(V1)"), -i, 1e-7);
    EXPECT_NEAR(v.at("V(a)"), 10 - 5 * i, 1e-6);
  }
}

// Without uic a circuit begins at rest: the divider.
TEST(Circuit, BeginsAtItsOperatingPoint) {
  const Circuit c =
      circuit_of("V1 in 0 10\nR1 in a 1k\nR2 a 0 3k\nC1 a 0 1u\nD1 b a DI\nR3 b 0 1k\n.model DI D(Ron=1)\n.tran 1m\n");
  EXPECT_NEAR(c.scene.x0[0], 7.5, 1e-9);
}

// Two capacitors in parallel are one state; three in a loop with a source are one less.
TEST(Circuit, CapacitorsInLoops) {
  EXPECT_EQ(circuit_of("V1 a 0 1\nR1 a b 1k\nC1 b 0 1u\nC2 b 0 2u\n.tran 1m uic\n").scene.states(), 1);
  // C1 and C2 in series across V1 = 10 t/ms: b follows with C1 / (C1 + C2) of its slope, beside R2.
  const Circuit c = circuit_of("V1 a 0 PWL(0 0 1m 10)\nC1 a b 1u\nC2 b 0 3u\nR2 b 0 1k\n.tran 1m uic\n");
  EXPECT_EQ(c.scene.states(), 1);
  const double tau = 4e-3, slope = 1e4, t = 0.8e-3;  // (C1 + C2) v' + v / R = C1 slope
  const double v = 1e-6 * slope * 1e3 * -std::expm1(-t / tau);
  const auto found = values(c, {t})[0];
  EXPECT_NEAR(found.at("V(b)"), v, 1e-6 * v);
  const double current = 1e-6 * (slope - (1e-6 * slope - v / 1e3) / 4e-6);  // of C1
  EXPECT_NEAR(found.at("I(C1)"), current, 1e-6 * current);
  EXPECT_NEAR(found.at("I(V1)"), -current, 1e-6 * current);
}

// A part that diodes alone join to the rest: their resistances, however large, state its voltage. By symmetry V(p) +
// V(n) is V(s) + V(b), open and closed.
TEST(Circuit, LargeResistancesHoldPartsThatFloat) {
  for (const char* off : {"1Meg", "1e9", "1e12"}) {
    const Circuit c = circuit_of(
        std::string("Vin a b SIN(0 325 50)\nRg b 0 1k\nRs a s 0.5\nD1 s p DI\nD2 b p DI\nD3 n s DI\nD4 n b DI\n"
                    "C1 p n 100u\nR1 p n 200\n.model DI D(Ron=10m Vfwd=0 Roff=") +
        off + ")\n.tran 100u 30m uic\n");
    EXPECT_TRUE(c.reduction.open.empty()) << off;
    for (const auto& v : values(c, {3e-3, 8e-3, 9.7e-3, 14e-3, 21e-3, 29e-3}))
      EXPECT_NEAR(v.at("V(p)") + v.at("V(n)"), v.at("V(s)") + v.at("V(b)"), 1e-3) << off;
  }
}

// Beside other paths they count as open.
TEST(Circuit, LargeResistancesBesideOthersAreOpen) {
  const Circuit c =
      circuit_of("V1 a 0 SIN(0 10 50)\nD1 a b DI\nR1 b 0 10\nC1 b 0 1m\n.model DI D(Roff=1e9)\n.tran 20m uic\n");
  EXPECT_EQ(c.reduction.open, (std::vector<std::string>{"D1"}));
  ASSERT_FALSE(c.notes.empty());
  EXPECT_EQ(c.notes.back(), "Roff of D1 counts as open");
}

// An ideal transformer of ratio 3: R2 is seen as R2 / 9 beside the magnetising inductance.
TEST(Circuit, WindingsWithFullCoupling) {
  const Circuit c = circuit_of("V1 in 0 1\nR1 in a 1\nL1 a 0 1m\nL2 b 0 9m\nK1 L1 L2 1\nR2 b 0 9\n.tran 5m uic\n");
  EXPECT_EQ(c.scene.states(), 1);
  const double t = 0.7e-3, parallel = 0.5, v = 0.5 * std::exp(-t * parallel / 1e-3);
  const auto found = values(c, {t})[0];
  EXPECT_NEAR(found.at("V(a)"), v, 1e-6);
  EXPECT_NEAR(found.at("V(b)"), 3 * v, 3e-6);
  EXPECT_NEAR(found.at("I(L2)"), -3 * v / 9, 1e-6);
}

// Half a wave through a diode: at the peak (5 - 0.6) V over 10 ohm, and nothing the other way.
TEST(Circuit, DiodeIsTwoLines) {
  const Circuit c = circuit_of(
      "V1 in 0 SIN(0 5 1k)\nD1 in a DI\nR1 a 0 9\nC1 x 0 1u\nR2 x 0 1k\n.model DI D(Ron=1 Vfwd=0.6)\n.tran 1m uic\n");
  const auto found = values(c, {0.25e-3, 0.75e-3});
  EXPECT_NEAR(found[0].at("I(D1)"), 0.44, 1e-9);
  EXPECT_NEAR(found[0].at("V(a)"), 3.96, 1e-8);
  EXPECT_NEAR(found[1].at("I(D1)"), 0, 1e-9);
}

// The netlists of examples/, with their own tolerance.
TEST(Circuit, ExamplesAreSolved) {
  const auto backend = make_cpu_backend(1);
  for (const auto& file : std::filesystem::directory_iterator(BROMWICH_EXAMPLES "/circuits")) {
    const Circuit c = read_circuit(file.path());
    EXPECT_TRUE(c.notes.empty()) << file.path();
    Options options;
    options.tolerance_x = 1e-4;
    options.states = StateSelection::all;
    const Result r = solve(c.scene, *backend, options);
    EXPECT_EQ(r.status, Status::solved) << file.path() << ": " << r.reason;
    EXPECT_TRUE(output_values(c, r).bottomRows(1).allFinite()) << file.path();
  }
}

struct Known {
  const char* name;
  std::string cards;
  std::vector<std::pair<double, std::map<std::string, double>>> values;  ///< at times
};

const std::string models =
    ".model SI SW(Ron=10m Roff=1Meg Vt=2.5 Vh=0)\n.model S2 SW(Ron=20m Roff=1Meg Vt=2.5 Vh=0)\n"
    ".model DI D(Ron=10m Vfwd=.5 Roff=1Meg)\n";

std::string multiplier() {
  std::string cards = ".model DM D(Ron=1 Vfwd=.7 Roff=10Meg)\nVa a0 0 SIN(0 100 1k)\n";
  for (int k = 1; k <= 5; ++k)
    cards += fmt::format("Ca{1} a{0} a{1} 1u\nDa{1} b{0} a{1} DM\nDb{1} a{1} b{1} DM\nCb{1} b{0} b{1} 1u\n", k - 1, k);
  return cards + "Vb b0 0 0\nRL b5 0 1Meg\n.tran 1m 50m uic\n";
}

class KnownCircuits : public testing::TestWithParam<Known> {};

TEST_P(KnownCircuits, AgreeWithAModeByModeProgram) {
  const Known& known = GetParam();
  std::vector<double> times;
  for (const auto& [t, at] : known.values) times.push_back(t);
  const auto found = values(circuit_of(models + known.cards), times);
  for (std::size_t k = 0; k < times.size(); ++k)
    for (const auto& [name, value] : known.values[k].second)  // values have 8 digits
      EXPECT_NEAR(found[k].at(name), value, 1e-7 * std::abs(value)) << name << " at " << times[k];
}

INSTANTIATE_TEST_SUITE_P(
    Converters, KnownCircuits,
    testing::Values(
        Known{"buck",
              "Vin in 0 24\nS1 in sw g 0 SI\nVg g 0 PULSE(0 5 0 10n 10n 3.99u 10u)\nD1 0 sw DI\nL1 sw out 100u\nC1 out "
              "0 47u\n"
              "R1 out 0 5\n.tran 10u 2m uic\n",
              {{1e-3, {{"V(out)", 9.1249652}, {"I(L1)", 1.9269147}}},
               {2e-3, {{"V(out)", 9.3450049}, {"I(L1)", 1.5676854}}}}},
        Known{"flyback",
              "Vin in 0 24\nL1 in sw 100u\nL2 0 sec 6.25u\nK1 L1 L2 1\nS1 sw 0 g 0 S2\nVg g 0 PULSE(0 5 0 10n 10n "
              "7.99u 20u)\n"
              "D1 sec out DI\nC1 out 0 100u\nR1 out 0 20\n.tran 20u 4m uic\n",
              {{2e-3, {{"V(out)", 12.46472}}}, {4e-3, {{"V(out)", 13.173888}}}}},
        Known{"cuk",
              "Vin in 0 10\nL1 in a 180u\nS1 a 0 g 0 S2\nVg g 0 PULSE(0 5 0 10n 10n 8.99u 20u)\nC1 a b 47u\nD1 b 0 DI\n"
              "L2 b out 150u\nCo out 0 220u\nR1 out 0 3\n.tran 20u 4m uic\n",
              {{4e-3, {{"V(out)", -7.5295855}, {"I(L1)", 1.1060281}}}}},
        Known{"bridge",
              ".model SB SW(Ron=20m Roff=1Meg Vt=.5 Vh=0)\n.model DB D(Ron=10m Vfwd=.7 Roff=1Meg)\nVdc p 0 100\n"
              "V1 g1 0 PULSE(0 1 2u 10n 10n 496u 1m)\nV2 g2 0 PULSE(0 1 502u 10n 10n 496u 1m)\nS1 p a g1 0 SB\n"
              "S2 a 0 g2 0 SB\nS3 p b g2 0 SB\nS4 b 0 g1 0 SB\nD1 a p DB\nD2 0 a DB\nD3 b p DB\nD4 0 b DB\nL1 a c 2m\n"
              "R1 c b 10\n.tran 10u 10m uic\n",
              {{1e-2, {{"I(L1)", -8.2792441}}}}},
        Known{"synchronous",
              ".model SB SW(Ron=5m Roff=1Meg Vt=.5 Vh=0)\n.model DB D(Ron=5m Vfwd=.8 Roff=1Meg)\nVin in 0 12\n"
              "V1 g1 0 PULSE(0 1 40n 1n 1n 1.42u 5u)\nV2 g2 0 PULSE(0 1 1.54u 1n 1n 3.42u 5u)\nS1 in sw g1 0 SB\n"
              "S2 sw 0 g2 0 SB\nD1 sw in DB\nD2 0 sw DB\nL1 sw out 4.7u\nC1 out x 100u\nResr x 0 5m\nR1 out 0 .7\n"
              ".tran 5u 1m uic\n",
              {{1e-3, {{"V(out)", 3.3504919}, {"I(L1)", 3.5381958}}}}},
        // Two diodes close within 1e-20 s.
        Known{"six_pulse",
              ".model DB D(Ron=10m Vfwd=.8 Roff=1Meg)\nVa a n SIN(0 325 50)\nVb b n SIN(0 325 50 0 0 -120)\n"
              "Vc c n SIN(0 325 50 0 0 120)\nLa a u 1m\nLb b v 1m\nLc c w 1m\nD1 u p DB\nD2 v p DB\nD3 w p DB\n"
              "D4 0 u DB\nD5 0 v DB\nD6 0 w DB\nL1 p q 5m\nC1 q 0 470u\nR1 q 0 30\n.tran 50u 100m uic\n",
              {{5e-2, {{"V(q)", 519.13466}, {"I(Lb)", 17.180943}}},
               {1e-1, {{"V(q)", 526.94773}, {"I(Lb)", -17.365391}}}}},
        Known{"multiplier", multiplier(), {{25e-3, {{"V(b5)", 497.372207}}}, {50e-3, {{"V(b5)", 685.150543}}}}},
        Known{"resonant",
              ".model SB SW(Ron=100m Roff=1Meg Vt=.5 Vh=0)\n.model DB D(Ron=50m Vfwd=.8 Roff=1Meg)\n"
              ".model DO D(Ron=5m Vfwd=.4 Roff=1Meg)\nVin p 0 400\nS1 p m g1 0 SB\nS2 m 0 g2 0 SB\nD1 m p DB\n"
              "D2 0 m DB\nV1 g1 0 PULSE(0 1 200n 10n 10n 4.58u 10u)\nV2 g2 0 PULSE(0 1 5.2u 10n 10n 4.58u 10u)\n"
              "Coss m 0 200p\nCr m r 24n\nLr r t 105u\nLp t 0 525u\nLs1 s1 0 1.4583u\nLs2 0 s2 1.4583u\n"
              "K1 Lp Ls1 Ls2 1\nD3 s1 out DO\nD4 s2 out DO\nC1 out 0 220u IC=10\nR1 out 0 .5\n.tran 10u 1m uic\n",
              {{1e-3, {{"V(out)", 10.02605}, {"I(Lr)", -0.79087827}}}}}),
    [](const auto& one) { return one.param.name; });

}  // namespace
}  // namespace bromwich
