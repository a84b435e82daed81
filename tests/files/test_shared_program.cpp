// Programs of expressions that scenes share, held against programs of their own with the parameters as constants.

#include "files/shared_program.hpp"

#include "files/expression.hpp"
#include "files/names.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

namespace bromwich {
namespace {

const std::map<std::string, std::size_t> numbers{{"a", 0}, {"b", 1}};

bool shared(const std::string& text) { return same_with_variables(read_formula(text, {}, "test", numbers)); }

TEST(SharedProgram, HasTheBitsOfConstantsWhereNothingIsPutTogether) {
  for (const char* text :
       {"a*sin(3*t)", "sin(a*t)", "b*sin(2*pi*a*t + b)", "cos(t)*a + 1", "exp(-a*t)", "a - t", "3*t + a", "a*b*t",
        "min(a, sin(t)) + max(b, 2)", "abs(t - a) > b", "(2*a + 1)*cos(t)", "t/a", "3*t^2 + 2*t + 1", "sin(t)^2"})
    EXPECT_TRUE(shared(text)) << text;
}

// The optimiser takes constants together, or makes products of powers; or the sign of a zero is seen.
TEST(SharedProgram, IsRefusedWhereConstantsAreTakenTogether) {
  for (const char* text : {"t*2*a", "t + 1 + a", "a*t*3", "3*t/a", "t^a", "a^2*t", "2*a*3*t", "1/(a*t)", "atan2(a, t)",
                           "a > t ? 1 : 2", "a > 1 && t > b", "a*t + t"})
    EXPECT_FALSE(shared(text)) << text;
}

// An expression with operands of every kind.
std::string some_expression(std::mt19937& random, int depth) {
  const auto below = [&](unsigned count) { return random() % count; };
  if (depth == 0 || below(5) == 0) {
    const char* leaves[] = {"t", "a", "b", "2", "0.3", "pi", "t"};
    return leaves[below(7)];
  }
  const std::string left = some_expression(random, depth - 1), right = some_expression(random, depth - 1);
  const char* signs[] = {" + ", " - ", " * ", " / ", " * ", " + "};
  switch (below(8)) {
    case 0:
      return "sin(" + left + ")";
    case 1:
      return "-(" + left + ")";
    case 2:
      return "max(" + left + ", " + right + ")";
    default:
      return (below(2) == 0 ? "(" + left + ")" : left) + signs[below(6)] + (below(2) == 0 ? "(" + right + ")" : right);
  }
}

// Bit by bit, save the sign of a zero. Other values of the parameters use the same program.
TEST(SharedProgram, GivesTheBitsOfConstants) {
  std::mt19937 random(7);
  Expressions expressions;
  int accepted = 0, of_parameters = 0;
  for (int i = 0; i < 3000; ++i) {
    const std::string text = some_expression(random, 4);
    if (!shared(text)) continue;
    ++accepted;
    for (const char* value : {"1.37", "0.0821"}) {
      const auto written_out = with_names_replaced(text, [&](const std::string& name, std::string& by) {
        if (name == "a") by = value;
        if (name == "b") by = "0.71";
        return name == "a" || name == "b";
      });
      of_parameters += written_out != text;
      expressions.begin_scene();
      expressions.define("a", std::stod(value), "test");
      expressions.define("b", 0.71, "test");
      const TimeFunction with_variables = expressions.in_time({"(" + text + ")", "t"}),
                         with_constants = expressions.in_time({"(" + written_out + ")", "t"});
      for (const double t : {0., 0.123456789, 1., 2.7182818}) {
        Vector found(2), expected(2);
        with_variables(t, found);
        with_constants(t, expected);
        EXPECT_TRUE(found[0] == expected[0] || (std::isnan(found[0]) && std::isnan(expected[0])))
            << text << " at " << t << ": " << found[0] - expected[0];
      }
    }
  }
  EXPECT_GT(accepted, 300) << "otherwise the comparison says little";
  EXPECT_GT(of_parameters, 300);
}

// A function of a scene keeps its values when the next scene takes the program.
TEST(SharedProgram, ServesScenesSideBySide) {
  Expressions expressions;
  std::vector<TimeFunction> functions;
  for (int k = 0; k < 4; ++k) {
    expressions.begin_scene();
    expressions.define("a", 0.1 * k, "test");
    functions.push_back(expressions.in_time({"a*cos(t)", "t^2 + t*a"}));
  }
  for (int k = 3; k >= 0; --k) {
    Vector value(2);
    functions[std::size_t(k)](0.5, value);
    EXPECT_EQ(value[0], 0.1 * k * std::cos(0.5));
  }
}

}  // namespace
}  // namespace bromwich
