// Netlists at many operating points, against closed forms.

#include "circuits/operating_map.hpp"
#include "core/base/error.hpp"
#include "tests/circuits/circuits.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace operating_map_test {

// A square wave of 1 kHz behind R and C = 1 uF, and a load that only the efficiency sees.
const std::string wave =
    "t\n.param duty=0.3 R=1k\n.step param duty 0.2 0.8 0.2\n.step param R list 500 1k 3k\n"
    "V1 a 0 PULSE(0 1 0 0 0 {duty*1m} 1m)\nR1 a b {R}\nC1 b 0 1u\nV2 c 0 6\nR2 c d 1\nR3 d 0 5\n.tran 1u 1m\n";

OperatingMap map_of(const std::string& netlist, const std::vector<std::string>& columns, std::optional<double> period,
                    int threads = 1) {
  const ReadCircuit read = [&](const std::map<std::string, double>& point) {
    return parse_circuit(netlist, "test.cir", {}, point, period);
  };
  Options options;
  options.states = StateSelection::all;
  if (period)
    options.steps = 16;
  else
    options.tolerance_x = 1e-8;
  const auto backend = make_cpu_backend(threads);
  const Circuit c = read({});
  return operating_map(
      read, c.steps, columns.empty() ? map_columns(c) : columns, options, *backend,
      [] { return std::shared_ptr<Backend>(make_cpu_backend(1)); }, "--columns");
}

TEST(OperatingMap, PeriodicStatesOverDutyAndResistance) {
  for (const int threads : {1, 3}) {
    const OperatingMap m =
        map_of(wave, {"mean(V(b))", "ripple(V(b))", "power(R3)", "efficiency", "rms(V(a))", "max(V(b))"}, 0, threads);
    ASSERT_EQ(m.points(), 12);
    EXPECT_EQ(m.units, (std::vector<std::string>{"V", "V", "W", "", "V", "V"}));
    for (Index i = 0; i < 12; ++i) {
      ASSERT_EQ(m.status[std::size_t(i)], Status::solved) << m.reason[std::size_t(i)];
      const double duty = m.settings(i, 0), tau = m.settings(i, 1) * 1e-6;
      EXPECT_NEAR(duty, 0.2 + 0.2 * double(i / 3), 1e-12);
      const double q = std::exp(-duty * 1e-3 / tau), p = std::exp(-(1 - duty) * 1e-3 / tau);
      const double high = (1 - q) / (1 - p * q);
      EXPECT_NEAR(m.values(i, 0), duty, 1e-9);
      EXPECT_NEAR(m.values(i, 1), high * (1 - p), 1e-7);
      EXPECT_NEAR(m.values(i, 2), 5, 1e-9);
      // R1 takes rms(V(a) - V(b))^2 / R from V1, beside 6 W of V2
      EXPECT_LT(m.values(i, 3), 5.0 / 6);
      EXPECT_GT(m.values(i, 3), 5.0 / (6 + 1 / m.settings(i, 1)));
      EXPECT_NEAR(m.values(i, 4), std::sqrt(duty), 1e-9);
      EXPECT_NEAR(m.values(i, 5), high, 1e-7);
    }
  }
}

TEST(OperatingMap, MeasuresOfTransients) {
  const OperatingMap m = map_of(
      "t\n.step dec param tau 1 100 1\nV1 a 0 1\nR1 a b {tau*1k}\nC1 b 0 1u\n.tran 10u 5m uic\n"
      ".meas tran half WHEN V(b)=0.5\n.meas late FIND V(b) AT=5m\n",
      {}, {});
  EXPECT_EQ(m.columns, (std::vector<std::string>{"half", "late"}));
  EXPECT_EQ(m.units[0], "s");
  ASSERT_EQ(m.points(), 3);
  for (Index i = 0; i < 3; ++i) {
    const double tau = m.settings(i, 0) * 1e-3;
    EXPECT_NEAR(m.values(i, 1), -std::expm1(-5e-3 / tau), 1e-7);
    if (i == 0)
      EXPECT_NEAR(m.values(i, 0), tau * std::log(2), 1e-9);
    else
      EXPECT_TRUE(std::isnan(m.values(i, 0)));
  }
}

TEST(OperatingMap, PointsThatCannotBeReadAreNamed) {
  const OperatingMap m = map_of("t\n.step param R list 1 0 2\nV1 a 0 1\nR1 a 0 {R}\n.tran 1m 1m uic\n", {"I(R1)"}, {});
  EXPECT_EQ(m.status[0], Status::solved);
  EXPECT_EQ(m.status[1], Status::unsupported);
  EXPECT_NE(m.reason[1].find("R1 = 0"), std::string::npos);
  EXPECT_NEAR(m.values(2, 0), 0.5, 1e-12);
  EXPECT_TRUE(std::isnan(m.values(1, 0)));
}

TEST(OperatingMap, MistakesAreNamed) {
  EXPECT_THROW(map_of(wave, {"mean(V(nowhere))"}, 0), Error);
  EXPECT_THROW(map_of(wave, {"power(R9)"}, 0), Error);
  EXPECT_THROW(map_of("t\nV1 a 0 1\nR1 a 0 1\n.tran 1m 1m uic\n", {}, {}), Error);
}

}  // namespace operating_map_test
}  // namespace bromwich
