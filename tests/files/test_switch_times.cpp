// Switch times of expressions, against known edges and against values on both sides of random points.

#include "core/base/error.hpp"
#include "files/formula.hpp"
#include "files/switch_times.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <vector>

namespace bromwich {
namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();
constexpr long plenty = 30'000'000;

const ParameterValues parameters{{"D", 0.25}, {"P", 1e-3}, {"w", 2 * std::numbers::pi * 570}};

SwitchTimes found(const std::string& text, double T, long work = plenty) {
  return switch_times(read_formula(text, parameters, "here"), T, work);
}

/// The times inside (0, T): at the ends rounding may decide.
SwitchTimes inside(SwitchTimes times, double T) {
  std::erase_if(times.times, [T](double t) { return t == 0 || t == T; });
  return times;
}

/// Within a few roundings of the time, like the arguments of the functions.
void expect_times(const std::string& text, double T, const std::vector<double>& expected) {
  const SwitchTimes times = inside(found(text, T), T);
  EXPECT_TRUE(times.complete) << text;
  ASSERT_EQ(times.times.size(), expected.size()) << text;
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(times.times[i], expected[i], 16 * eps * T) << text;
}

std::vector<double> multiples(double period, double T, double offset = 0) {
  std::vector<double> times;
  for (long k = 0; offset + double(k) * period < T * (1 - 32 * eps); ++k)
    if (offset + double(k) * period > 0) times.push_back(offset + double(k) * period);
  return times;
}

std::vector<double> merged(std::vector<double> a, const std::vector<double>& b) {
  a.insert(a.end(), b.begin(), b.end());
  std::sort(a.begin(), a.end());
  return a;
}

TEST(SwitchTimes, SmoothExpressionsHaveNone) {
  for (const std::string text :
       {"1", "sin(w*t)", "exp(-((t-0.3)/1e-5)^2)", "t^2 - 3*t", "sqrt(1+t)", "tanh(1e5*(t-0.5))", "abs(D)*t",
        "max(D, P)*sin(t)", "abs(t+1)", "D > 0 ? t : -t", "max(2+sin(t), cos(t)-1)", "floor(D)*t", "sign(2+sin(w*t))",
        "heaviside(1.001+cos(w*t)*sin(300*t))", "abs(1+exp(t))", "mod(D, P)*t", "atan2(t, 1)"})
    expect_times(text, 1, {});
}

TEST(SwitchTimes, EdgesOfPulses) {
  expect_times("t > 0.2754 && t < 0.2902 ? 175.676 : 0", 1, {0.2754, 0.2902});
  expect_times("175.676*(t > 0.2754)*(t <= 0.2902)", 1, {0.2754, 0.2902});
  expect_times("heaviside(t-0.5)-heaviside(t-0.5000000001)", 1, {0.5, 0.5000000001});
  expect_times("t >= 1e-9 || t < 0 ? 1 : 2", 1, {1e-9});
  expect_times("t == 0.125", 1, {0.125});
  expect_times("t != 0.125 && t > 0.5", 1, {0.125, 0.5});
  // Gaussians of width 1e-7: edges at sqrt(log(2)) widths on both sides.
  const double half = 1e-7 * std::sqrt(std::log(2));
  const SwitchTimes bump = found("exp(-((t-0.3)/1e-7)^2) > 0.5", 1);
  ASSERT_EQ(bump.times.size(), 2u);
  EXPECT_NEAR(bump.times[0], 0.3 - half, 1e-15);
  EXPECT_NEAR(bump.times[1], 0.3 + half, 1e-15);
}

TEST(SwitchTimes, KinksOfAbsMinMax) {
  expect_times("abs(sin(2*pi*t))", 3.2, multiples(0.5, 3.2));
  expect_times("max(sin(2*pi*t), 0)", 3.2, multiples(0.5, 3.2));
  expect_times("min(t, 0.3, 1-t)", 1, {0.3, 0.7});
  expect_times("abs(t-0.25)+abs(t-0.75)", 1, {0.25, 0.75});
  expect_times("max(0, min(1, 4*(t-0.25)))", 1, {0.25, 0.5});
  expect_times("cbrt(t-0.5)", 1, {0.5});
}

TEST(SwitchTimes, SquareWavesOfEveryFrequency) {
  for (const double f : {1., 570., 12800., 99991.}) {
    const ParameterValues values{{"f", f}};
    long work = plenty;
    const SwitchTimes times = inside(switch_times(read_formula("sign(sin(2*pi*f*t))", values, "here"), 0.1, work), 0.1);
    const std::vector<double> expected = multiples(0.5 / f, 0.1);
    EXPECT_TRUE(times.complete) << f;
    ASSERT_EQ(times.times.size(), expected.size()) << f;
    for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(times.times[i], expected[i], 4 * eps * 0.1) << f;
  }
}

TEST(SwitchTimes, PulseWidthModulation) {
  expect_times("mod(t, P) < D*P", 0.1, merged(multiples(1e-3, 0.1), multiples(1e-3, 0.1, 2.5e-4)));
  expect_times("floor(t/P)", 10, multiples(1e-3, 10));  // 10^4 edges
  expect_times("ceil(t)+floor(2*t)", 3.1, multiples(0.5, 3.1));
  expect_times("round(t)", 3.1, {0.5, 1.5, 2.5});
  expect_times("mod(-t, 0.25)", 1, multiples(0.25, 1));
  expect_times("abs(mod(t, 0.5) - 0.25)", 1.1, multiples(0.25, 1.1));
  expect_times("mod(floor(4*t), 2) == 0 ? t : 1-t", 1, multiples(0.25, 1));
  expect_times("atan2(sin(2*pi*t), cos(2*pi*t))", 2.2, {0.5, 1.5});
  // A sine against a carrier: 0.8 sin(2 pi t) = 2 mod(10 t, 1) - 1 once per period of the carrier.
  const SwitchTimes natural = inside(found("0.8*sin(2*pi*t) > 2*mod(10*t, 1) - 1", 1), 1);
  EXPECT_TRUE(natural.complete);
  EXPECT_EQ(natural.times.size(), 19u);  // 10 crossings and 9 ends of a period between 0 and 1
}

TEST(SwitchTimes, ValuesAreThoseFromTheRight) {
  for (const std::string text : {"t > 0.3", "t >= 0.3", "t < 0.3", "t <= 0.3", "sign(t-0.3)", "floor(t+0.7)"}) {
    const Formula formula = read_formula(text, {}, "here");
    const SwitchTimes times = found(text, 1);
    ASSERT_EQ(times.times.size(), 1u) << text;
    EXPECT_EQ(formula(times.times[0]), formula(0.9)) << text;
    EXPECT_EQ(formula(times.times[0] - 32 * eps), formula(0.1)) << text;
  }
}

TEST(SwitchTimes, ValuesAtTheEndsThatAreNotThoseBeside) {
  const SwitchTimes wave = found("sign(sin(pi*t))", 1.5);
  ASSERT_EQ(wave.times.size(), 2u);
  EXPECT_EQ(wave.times[0], 0);
  EXPECT_NEAR(wave.times[1], 1, 4 * eps);
  EXPECT_EQ(found("t > 0", 1).times, (std::vector<double>{0}));
  EXPECT_EQ(found("t >= 0.75", 0.75).times, (std::vector<double>{0.75}));
  EXPECT_EQ(found("floor(t)", 2).times, (std::vector<double>{1, 2}));
  EXPECT_TRUE(found("t >= 0", 1).times.empty());
  EXPECT_TRUE(found("t <= 1", 1).times.empty());
}

TEST(SwitchTimes, TouchingIsNoSwitchAndEndsTheWork) {
  EXPECT_TRUE(found("abs(1 - cos(2*pi*t))", 10).complete);
  EXPECT_TRUE(found("sin(t)^2 >= 0", 10).complete);
  EXPECT_TRUE(found("max((t-0.4321)^2, 0)", 1).complete);
}

TEST(SwitchTimes, WorkIsBounded) {
  long work = 100'000;
  const SwitchTimes times = switch_times(read_formula("sign(sin(1e9*t))", {}, "here"), 1, work);
  EXPECT_FALSE(times.complete);
  EXPECT_GT(work, 50'000);  // a small part shows that all edges would cost far more
  work = 1'000'000;
  switch_times(read_formula("heaviside(sin(t)^2+cos(t)^2-1)", {}, "here"), 1, work);  // rounding alone
  EXPECT_GT(work, -10'000);
}

/// A random expression of depth `left`.
std::string random_text(std::mt19937_64& random, int left) {
  const auto pick = [&](int count) { return int(std::uniform_int_distribution<>(0, count - 1)(random)); };
  const auto number = [&] { return std::to_string(std::uniform_real_distribution<>(-3, 3)(random)); };
  if (left == 0) return pick(3) > 0 ? "t" : number();
  const auto part = [&] { return random_text(random, left - 1); };
  static const std::vector<std::string> functions{"sin",   "cos",  "exp",   "abs",  "sign", "heaviside",
                                                  "floor", "ceil", "round", "tanh", "atan", "cbrt"};
  switch (pick(8)) {
    case 0:
      return "(" + part() + "+" + part() + ")";
    case 1:
      return "(" + part() + "*" + part() + ")";
    case 2:
      return "(" + number() + "*" + part() + ")";
    case 3:
      return "max(" + part() + "," + part() + ")";
    case 4:
      return "(" + part() + (pick(2) > 0 ? "<" : ">=") + part() + ")";
    case 5:
      return "(" + part() + ">0 ? " + part() + " : " + part() + ")";
    case 6:
      return "mod(" + part() + ",0.7)";
    default:
      return functions[std::size_t(pick(int(functions.size())))] + "(" + part() + ")";
  }
}

// Between the times found the expression is continuous: on shrinking pieces its change shrinks too. A jump changes it
// by the same amount on every piece.
TEST(SwitchTimes, BetweenThemExpressionsAreContinuous) {
  std::mt19937_64 random(20);
  int checked = 0, with_switches = 0;
  for (int trial = 0; trial < 150; ++trial) {
    const std::string text = random_text(random, 3);
    const Formula formula = read_formula(text, {}, "here");
    const double T = 2;
    const SwitchTimes times = found(text, T, 300'000);
    if (!times.complete) continue;
    ++checked;
    with_switches += !times.times.empty();
    for (int probe = 0; probe < 200; ++probe) {
      double a = std::uniform_real_distribution<>(0, T)(random), b = std::min(T, a + 0.02);
      const auto next = std::upper_bound(times.times.begin(), times.times.end(), a);
      if (next != times.times.end()) b = std::min(b, *next - 64 * eps * T);
      if (!(b - a > 1e-9)) continue;
      // 24 halvings towards the larger change: a Lipschitz function, or a cube root, has then changed little.
      const double scale = 1 + std::abs(formula(a)) + std::abs(formula(b));
      if (!std::isfinite(scale) || scale > 1e6) continue;
      double lipschitz = 0;
      for (int k = 0; k < 24; ++k) {
        const double middle = a + (b - a) / 2, at_middle = formula(middle);
        const bool left = std::abs(at_middle - formula(a)) > std::abs(formula(b) - at_middle);
        (left ? b : a) = middle;
        lipschitz = std::abs(formula(b) - formula(a)) / (b - a);
      }
      // A jump of 1e-2 over 2e-2 / 2^24 has a difference quotient of 1e7; the expressions grow by at most e^{e^e} where
      // they are below 1e6.
      EXPECT_TRUE(lipschitz < 1e6 * scale || std::abs(formula(b) - formula(a)) < 1e-3 * scale)
          << text << " at " << a << ": " << formula(a) << " and " << formula(b);
    }
  }
  EXPECT_GT(checked, 120);
  EXPECT_GT(with_switches, 50);
}

TEST(Formula, RefusesWhatIsNone) {
  for (const std::string text : {"", "(", "t+", "2 3", "sin", "sin()", "x", "max()", "1,2", "t ? 1", "a = 2", "*t", ")",
                                 "mod(t)", "1..2", "2e", "t t"})
    EXPECT_THROW(read_formula(text, {}, "here"), Error) << text;
  EXPECT_THROW(read_formula(std::string(5000, '(') + "t" + std::string(5000, ')'), {}, "here"), Error);
  EXPECT_THROW(read_formula(std::string(5000, '-') + "t", {}, "here"), Error);
}

}  // namespace
}  // namespace bromwich
