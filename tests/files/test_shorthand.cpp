// pulse, pwl and definitions: against the functions they stand for, written here as such.

#include "core/base/error.hpp"
#include "files/expression.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <vector>

namespace bromwich {
namespace {

struct Source {
  std::string text;
  std::function<double(double)> meaning;
};

class Shorthand : public testing::Test {
 protected:
  Shorthand() {
    expressions_.define("R", 2, "here");
    expressions_.define_in_time("wave", "sin(3*t)", "here");
    expressions_.define_in_time("both", "wave + R*wave", "here");
  }
  std::function<double(double)> function(const std::string& text) const {
    return [f = expressions_.in_time({expressions_.in_full(text, "here")})](double t) {
      Vector value(1);
      f(t, value);
      return value[0];
    };
  }
  std::vector<double> breaks(const std::string& text, double T) const {
    return expressions_.switch_times({expressions_.in_full(text, "here")}, T).times;
  }
  std::string refused(const std::string& text) const {
    return refusal([&] { expressions_.in_full(text, "here"); });
  }

  Expressions expressions_;
};

double modulo(double a, double b) { return a - b * std::floor(a / b); }

double trapezoid(double t) {  // pulse(t, -1, 3, 0.25, 0.125, 0.25, 0.5, 2): all numbers are exact
  if (t < 0.25) return -1;
  const double s = modulo(t - 0.25, 2);
  return s < 0.125 ? -1 + 32 * s : s < 0.625 ? 3 : s < 0.875 ? 3 - 16 * (s - 0.625) : -1;
}

// Sums and products of a few numbers of size 10: rounding of 1e-14.
TEST_F(Shorthand, HasTheValuesOfItsMeaning) {
  const std::vector<Source> sources{
      {"pulse(t, 0.5, 0.125)", [](double t) { return double(modulo(t, 0.5) < 0.125); }},
      {"1 + 2*pulse(t, 1, 0.5 + 0.25*sin(t))",
       [](double t) { return 1 + 2 * double(modulo(t, 1) < 0.5 + 0.25 * std::sin(t)); }},
      {"pulse(t, -1, 3, 0.25, 0.125, 0.25, 0.5, R)", trapezoid},
      {"pulse(t, 0, 1, 0, 0, 0, 0.5, 1)", [](double t) { return double(modulo(t, 1) < 0.5); }},
      {"pwl(t, 0, 1, 1, 3)", [](double t) { return t < 0   ? 1
                                                   : t < 1 ? 1 + 2 * t
                                                           : 3; }},
      {"pwl(t, 0.5, 1, 1, 2, 1, -4, 2, R)",
       [](double t) {
         return t < 0.5 ? 1 : t < 1 ? 1 + 2 * (t - 0.5) : t < 2 ? -4 + 6 * (t - 1) : 2;
       }},
      {"pwl(mod(t, 1), 0, 0, 0.25, 1, 1, 0)",
       [](double t) { return modulo(t, 1) < 0.25 ? 4 * modulo(t, 1) : (1 - modulo(t, 1)) / 0.75; }},
      {"both*t", [](double t) { return 3 * std::sin(3 * t) * t; }},
      {"pwl(wave, -1, 0, 1, 2) - R", [](double t) { return 1 + std::sin(3 * t) - 2; }},
  };
  for (const Source& source : sources) {
    const auto found = function(source.text);
    for (int k = 0; k < 300; ++k) {
      const double t = k / 64.0;  // with the edges
      EXPECT_NEAR(found(t), source.meaning(t), 1e-13) << source.text << " at " << t;
    }
  }
}

TEST_F(Shorthand, ManyPointsAreAsFewOnes) {
  std::string text = "pwl(t";
  for (int k = 0; k <= 200; ++k) text += ", " + std::to_string(k) + ", " + std::to_string(k * k % 7);
  const auto found = function(text + ")");
  for (int k = 0; k < 200; ++k) {
    const double a = k * k % 7, b = (k + 1) * (k + 1) % 7;
    EXPECT_NEAR(found(k + 0.25), a + 0.25 * (b - a), 1e-13);
  }
}

TEST_F(Shorthand, BreakpointsAreFound) {
  EXPECT_EQ(breaks("pulse(t, -1, 3, 0.25, 0.125, 0.25, 0.5, 2)", 3),
            (std::vector{0.25, 0.375, 0.875, 1.125, 2.25, 2.375, 2.875}));
  EXPECT_EQ(breaks("pwl(t, 0.5, 1, 1, 2, 1, -4, 2, 0)", 4), (std::vector{0.5, 1.0, 2.0}));
  EXPECT_EQ(breaks("pulse(t, 0.5, 0.125)", 1), (std::vector{0.125, 0.5, 0.625, 1.0}));
  EXPECT_TRUE(breaks("both", 1).empty());
}

TEST_F(Shorthand, MistakesSayWhatToDo) {
  const std::vector<Refused> cases{
      {"pulse(t)", "here: pulse has 1 arguments; write pulse(t, period, width), or pulse(t, low, high,"},
      {"pulse(t, 0, 1)", "here: the period of pulse is 0; give a positive one"},
      {"pulse(t, 0, 1, 0, 0.5, 0.5, 0.5, 1)",
       "here: pulse rises for 0.5, stays for 0.5 and falls for 0.5 in a period of 1;"},
      {"pulse(t, t, 1)", "here: 't' depends on the time t in 'pulse(t, t, 1)'; use t in the first argument"},
      {"pwl(t, 0, 1)", "here: pwl has 3 arguments; write pwl(t, t1, v1, t2, v2, ...)"},
      {"pwl(t, 0, 1, 2)", "here: pwl has 4 arguments;"},
      {"pwl(t, 1, 1, 0, 1)", "here: in pwl the time 0 follows 1; give ascending times"},
      {"pwl(t, 0, 1, 1, 1, 1, 2, 1, 3)", "here: in pwl the time 1 is given three times; give the values before"},
      {"pwl(t, 0, 1/0, 1, 1)", "here: '1/0' is infinite"},
      {"pwl(t, 0, q, 1, 1)", "here: 'pwl(t, 0, q, 1, 1)' uses 'q', which is not defined"},
      {"pulse", "here: 'pulse' uses the function 'pulse' without arguments; write pulse(...)"},
      {"puls(t, 1, 0.5)", "here: 'puls(t, 1, 0.5)' calls 'puls' (did you mean 'pulse'?)"},
      {"sine(t)", "here: 'sine(t)' calls 'sine' (did you mean 'sin"},
      {"sgn(t)", "here: 'sgn(t)' calls 'sgn' (did you mean 'sign'?)"},
      {"wave(1)", "here: 'wave(1)' calls 'wave'; write * to multiply"},
      {"pwl(t, 0, 1, 1, 1", "here: 'pwl(t, 0, 1, 1, 1' is no expression"},
  };
  for (const Refused& bad : cases) {
    const std::string found = refused(bad.text);
    EXPECT_TRUE(found.starts_with(bad.message)) << found << "\nexpected: " << bad.message;
  }
}

TEST_F(Shorthand, DefinitionsKeepTheirNames) {
  EXPECT_EQ(refusal([&] { expressions_.define_in_time("wave", "t", "here"); }),
            "here: 'wave' is defined twice; define it once");
  EXPECT_EQ(refusal([&] { expressions_.define_in_time("R", "t", "here"); }),
            "here: 'R' is defined twice; define it once");
  EXPECT_TRUE(refusal([&] {
                expressions_.number("2*wave", "here");
              }).starts_with("here: '2*wave' depends on the time t; only f, g"));
  EXPECT_EQ(expressions_.number("pulse(0.3, 1, 0.5)", "here"), 1) << "a constant";
}

TEST_F(Shorthand, GrowthByDefinitionsEnds) {
  std::string last = "t";
  const auto grow = [&] {
    for (int k = 0; k < 40; ++k) {
      expressions_.define_in_time("d" + std::to_string(k), last + "*" + last, "here");
      last = "d" + std::to_string(k);
    }
  };
  EXPECT_TRUE(refusal(grow).starts_with("here: the expression has more than 1000000 characters with its definitions;"));
}

}  // namespace
}  // namespace bromwich
