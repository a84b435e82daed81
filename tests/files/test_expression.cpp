// Expressions of scene files: values against the same formula in C++, and one-line errors for invalid text.

#include "core/base/error.hpp"
#include "files/expression.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <locale>
#include <numbers>
#include <string>
#include <thread>
#include <vector>

namespace bromwich {
namespace {

using reference::pi;

/// R = 1000 and C = 1e-6 are defined.
class ExpressionTest : public testing::Test {
 protected:
  ExpressionTest() {
    expressions_.define("R", 1e3, "here");
    expressions_.define("C", 1e-6, "here");
  }
  double value(const std::string& text) const { return expressions_.number(text, "here"); }
  double at(double t, const std::string& text) const {
    Vector entry(1);
    expressions_.in_time({expressions_.in_full(text, "here")})(t, entry);
    return entry[0];
  }
  /// The message of the Error thrown for the text.
  std::string refusal(const std::string& text, bool in_time = false) const {
    try {
      if (in_time)
        expressions_.in_full(text, "here");
      else
        value(text);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }

  Expressions expressions_;
};

struct Case {
  std::string text;
  double value;
};

// The same operations in the same order give the same doubles. Library functions may be folded at compile time here and
// called at run time there, which allows for a last bit or two.
TEST_F(ExpressionTest, FollowsTheUsualRules) {
  const std::vector<Case> cases{
      {"-1/C", -1e6},        {"1/(R*C)", 1 / (1e3 * 1e-6)},
      {"2*pi", 2 * pi},      {" 1 + 2*3 ", 7},
      {"-2^2", -4},          {"2^3^2", 512},
      {"2^-1", 0.5},         {"1.5e-3", 1.5e-3},
      {".5", 0.5},           {"2E+2", 200},
      {"7 - 2 - 1", 4},      {"8/4/2", 1},
      {"R > 1 ? 3 : 4", 3},  {"(R < 1) + (1 <= 1) + (2 != 3) + (1 == 1)", 3},
      {"R > 1 && C > 1", 0}, {"R > 1 || C > 1", 1},
      {"1/3", 1. / 3},
  };
  for (const Case& one : cases) EXPECT_DOUBLE_EQ(value(one.text), one.value) << one.text;
}

TEST_F(ExpressionTest, KnowsItsFunctions) {
  const std::vector<Case> cases{
      {"sin(1)", std::sin(1.)},
      {"cos(1)", std::cos(1.)},
      {"tan(1)", std::tan(1.)},
      {"asin(0.5)", std::asin(0.5)},
      {"acos(0.5)", std::acos(0.5)},
      {"atan(2)", std::atan(2.)},
      {"sinh(1)", std::sinh(1.)},
      {"cosh(1)", std::cosh(1.)},
      {"tanh(1)", std::tanh(1.)},
      {"exp(2)", std::exp(2.)},
      {"expm1(1e-9)", std::expm1(1e-9)},
      {"log(2)", std::log(2.)},
      {"ln(2)", std::log(2.)},
      {"log10(1000)", 3},
      {"log2(8)", 3},
      {"sqrt(2)", std::sqrt(2.)},
      {"cbrt(27)", 3},
      {"erf(0.5)", std::erf(0.5)},
      {"erfc(3)", std::erfc(3.)},
      {"abs(-3)", 3},
      {"sign(-3) + 10*sign(0) + 100*sign(2)", 99},
      {"heaviside(-1) + 10*heaviside(0) + 100*heaviside(2)", 110},
      {"floor(-1.5)", -2},
      {"ceil(-1.5)", -1},
      {"round(2.4)", 2},
      {"min(3, 1, 2)", 1},
      {"max(3, 7, 2, 5)", 7},
      {"pow(2, 10)", 1024},
      {"atan2(1, -1)", std::atan2(1., -1.)},
      {"mod(7, 3) + 10*mod(-1, 3)", 21},
  };
  EXPECT_EQ(cases.size() + 2, expression_functions().size());  // every function is tried once, pulse and pwl below
  for (const Case& one : cases) EXPECT_DOUBLE_EQ(value(one.text), one.value) << one.text;
}

TEST_F(ExpressionTest, RefusesWhatIsNoExpression) {
  struct Bad {
    std::string text, mentions;
  };
  const std::vector<Bad> cases{
      {"", "empty"},
      {"  ", "empty"},
      {"1 +", "no expression"},
      {"(1", "no expression"},
      {"1)", "no expression"},
      {"2 3", "no expression"},
      {"\"1\"", "no expression"},
      {"2 $ 3", "no expression"},
      {"1,5", "decimals with a point"},
      {"R = 2", "=="},
      {"r + 1", "'r', which is not defined (did you mean 'R'?)"},
      {"_pi", "not defined (did you mean 'pi'?)"},
      {"_e", "not defined"},
      {"e", "write exp(1)"},
      {"if(R > 1, 2, 3)", "write condition ? value : other"},
      {"R > 1 and R < 3", "write && between conditions"},
      {"R > 1 & R < 3", "has a single '&'"},
      {"R > 1 | R < 3", "write ||"},
      {"2**R", "write a power with ^"},
      {"7%R", "write a remainder as mod(a, b)"},
      {"2R", "has '2R'; write a product with *, and factors such as k and m as 1e3 and 1e-3"},
      {"1k", "has '1k'; write a product with *"},
      {"R + 1.5e-3 ms", "has '1.5e-3 ms'; write a product with *"},
      {"2e", "write exp(1)"},
      {"2.e3x", "has '2.e3x'"},
      {"2 if R > 1 else 3", "write condition ? value : other"},
      {"R \u2212 1", "has '\u2212'; write -"},
      {"2\u00b7R", "has '\u00b7'; write *"},
      {"R\u00b2", "has '\u00b2'; write ^2"},
      {"np.sin(1)", "without 'np.'"},
      {"t", "depends on the time"},
      {"t + 1", "depends on the time"},
      {"sinn(1)", "calls 'sinn' (did you mean 'sin'?)"},
      {"sin", "without arguments"},
      {"R(2)", "write * to multiply"},
      {"sin()", "no expression"},
      {"sin(1, 2)", "no expression"},
      {"pow(1)", "no expression"},
      {"1/0", "infinite"},
      {"0/0", "not a number"},
      {"sqrt(-1)", "not a number"},
      {"log(0)", "infinite"},
      {"1e400", "no expression"},
  };
  for (const Bad& bad : cases) {
    const std::string found = refusal(bad.text);
    EXPECT_TRUE(found.starts_with("here: ")) << bad.text << ": " << found;
    EXPECT_NE(found.find(bad.mentions), std::string::npos) << bad.text << ": " << found;
    EXPECT_EQ(found.find('\n'), std::string::npos) << bad.text;
  }
  EXPECT_NE(refusal("sin(2*pi*q)", true).find("'q'"), std::string::npos);
  EXPECT_NE(refusal("t = 2", true).find("=="), std::string::npos);
  EXPECT_NE(refusal("1/0 ", true).find("infinite"), std::string::npos);
}

TEST_F(ExpressionTest, RefusesNamesThatHaveAMeaning) {
  for (const std::string name : {"t", "pi", "sin", "max", "2R", "a b", "", "R", "a-b"})
    EXPECT_THROW(expressions_.define(name, 1, "here"), Error) << name;
}

/// Decimals with a comma, as in much of Europe.
struct Comma : std::numpunct<char> {
  char do_decimal_point() const override { return ','; }
};

TEST_F(ExpressionTest, IgnoresTheLocale) {
  const std::locale before = std::locale::global(std::locale(std::locale::classic(), new Comma));
  const double found = value("1.5 + 0.25"), in_time = at(1, "1.5*t");
  const std::string refused = refusal("1,5");
  std::locale::global(before);
  EXPECT_EQ(found, 1.75);
  EXPECT_EQ(in_time, 1.5);
  EXPECT_NE(refused, "");
}

TEST_F(ExpressionTest, TimeEntriesMixWithConstants) {
  const TimeFunction f = expressions_.in_time({"R", "t", "2*t + R", "heaviside(t - 1)", "t > 0.5 ? t : -t"});
  Vector value(5);
  f(0.75, value);
  EXPECT_EQ(value, (Vector{{1e3, 0.75, 1001.5, 0, 0.75}}));
  f(1, value);
  EXPECT_EQ(value, (Vector{{1e3, 1, 1002, 1, 1}}));
}

TEST_F(ExpressionTest, EntriesOfOneTextAreOneColumn) {
  const TimeFunction f = expressions_.in_time({"R", "t", "0", "t", "2*t", "C"});
  ASSERT_NE(f.separable(), nullptr);
  EXPECT_EQ(f.separable()->shapes.cols(), 3);
  Vector value(6);
  f(0.75, value);
  EXPECT_EQ(value, (Vector{{1e3, 0.75, 0, 0.75, 1.5, 1e-6}}));
  const TimeFunction constants = expressions_.in_time({"R", "0", "C"});
  ASSERT_NE(constants.separable(), nullptr);
  EXPECT_TRUE(constants.linear());
  EXPECT_EQ(constants.separable()->shapes, (Vector{{1e3, 0, 1e-6}}));
  EXPECT_EQ(expressions_.in_time({"t", "2*t"}).separable(), nullptr);
}

TEST_F(ExpressionTest, ManyEntriesKeepTheirOrder) {
  // More text than one call of the parser takes.
  std::vector<std::string> texts;
  for (int i = 0; i < 997; ++i) texts.push_back("t*" + std::to_string(i) + " + 0*sin(2*pi*t) + 0*cos(2*pi*t)");
  Vector value(997);
  expressions_.in_time(texts)(2, value);
  for (Index i = 0; i < 997; ++i) EXPECT_EQ(value[i], 2. * double(i));
}

TEST_F(ExpressionTest, SeveralThreadsShareOneFunction) {
  const TimeFunction f = expressions_.in_time({"t", "R*t", "min(t, 1)", "R"});
  std::atomic<int> wrong = 0;
  const auto work = [&](int offset) {
    Vector value(4);
    for (int i = 0; i < 5000; ++i) {
      const double t = offset + i / 1024.;  // exact in binary, and so are all products
      f(t, value);
      if (value != Vector{{t, 1e3 * t, std::min(t, 1.), 1e3}}) ++wrong;
    }
  };
  std::vector<std::thread> threads;
  for (int k = 0; k < 8; ++k) threads.emplace_back(work, k);
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
}

TEST_F(ExpressionTest, SingularitiesInTimeAreLeftToTheSolver) { EXPECT_TRUE(std::isinf(at(0, "1/t"))); }

}  // namespace
}  // namespace bromwich
