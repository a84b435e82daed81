// .step cards: the values that they name.

#include "core/base/error.hpp"
#include "tests/circuits/circuits.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace step_cards_test {

using test::circuit_of;
using test::message_of;

const std::string rest = "\nV1 a 0 {x}\nR1 a 0 {y}\n.tran 1m uic\n";

TEST(StepCards, ValuesOfEveryForm) {
  const Circuit c = circuit_of(
      ".param x=3 y=7\n.step param x 1 2 0.1\n.step dec param y 1 1k 2\n.step oct param z 1 8 1\n"
      ".step param w LIST 5 {2*x} 1k\n.step lin param v 3 1 -1" +
      rest);
  ASSERT_EQ(c.steps.size(), 5u);
  EXPECT_EQ(c.steps[0].name, "x");
  ASSERT_EQ(c.steps[0].values.size(), 11u);
  EXPECT_NEAR(c.steps[0].values[10], 2, 1e-15);
  ASSERT_EQ(c.steps[1].values.size(), 7u);
  for (int k = 0; k < 7; ++k) EXPECT_NEAR(c.steps[1].values[std::size_t(k)], std::pow(10, k / 2.0), 1e-12 * 1e3);
  EXPECT_EQ(c.steps[2].values, (std::vector<double>{1, 2, 4, 8}));
  EXPECT_EQ(c.steps[3].values, (std::vector<double>{5, 6, 1000}));
  EXPECT_EQ(c.steps[4].values, (std::vector<double>{3, 2, 1}));
  // .param decides before a map is made, and the first value where there is none
  EXPECT_EQ(c.parameters.at("x"), 3);
  EXPECT_EQ(c.parameters.at("z"), 1);
}

TEST(StepCards, SettingsFixAParameter) {
  const Circuit c = parse_circuit("t\n.step param x 1 3 1\n.step param y 1 2 1" + rest, "test.cir", {}, {{"X", 2}});
  ASSERT_EQ(c.steps.size(), 1u);
  EXPECT_EQ(c.steps[0].name, "y");
  EXPECT_EQ(c.parameters.at("x"), 2);
}

TEST(StepCards, OtherStepsAreNamedAsNotRead) {
  const Circuit c = circuit_of(".param x=1 y=1\n.step temp 0 100 10\n.step V1 1 2 1" + rest);
  EXPECT_TRUE(c.steps.empty());
  ASSERT_EQ(c.notes.size(), 1u);
  EXPECT_EQ(c.notes[0], "not read: .step temp .step v1");
}

TEST(StepCards, MistakesAreNamed) {
  const std::pair<const char*, const char*> mistakes[] = {
      {".step param x 1 3", "line 3: .step has 2 numbers"},
      {".step param x 1 3 -1", "from 1 to 3 by -1 leads nowhere"},
      {".step param x 1 3 0", "has inf values"},
      {".step param x 0 1 1e-9", "has 1e+09 values"},
      {".step dec param x 0 10 3", "dec from 0 to 10"},
      {".step log param x 1 10 3", "'log' is unknown"},
      {".step param x list", "has an empty list"},
      {".step param x 1 2 1\n.step param x 1 2 1", "stepped twice"}};
  for (const auto& [card, words] : mistakes)
    EXPECT_NE(message_of(".param x=1 y=1\n" + std::string(card) + rest).find(words), std::string::npos)
        << card << ": " << message_of(".param x=1 y=1\n" + std::string(card) + rest);
}

}  // namespace step_cards_test
}  // namespace bromwich
