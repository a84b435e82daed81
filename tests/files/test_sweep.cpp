// [sweep]: the scenes that a file asks for, and what it must not ask for.

#include "files/sweep.hpp"

#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>

namespace bromwich {
namespace {

namespace fs = std::filesystem;

const std::string head = R"toml(
[parameters]
R = 2
C = "3*R"
[dynamics]
A = [[-1]]
B = [[1]]
x0 = [0]
[complementarity]
N = [[1]]
M = [["R"]]
[time]
T = 1
[sweep]
)toml";

Sweep swept(const std::string& lines, const ParameterValues& settings = {}, const fs::path& folder = {}) {
  const auto sweep = parse_sweep(head + lines, "s.toml", folder, settings);
  EXPECT_TRUE(sweep);
  return sweep.value_or(Sweep());
}

std::string refused(const std::string& lines, const fs::path& folder = {}) {
  return refusal([&] { parse_sweep(head + lines, "s.toml", folder); });
}

TEST(Sweep, ListsAreAProductAndTheLastVariesFastest) {
  const Sweep sweep = swept("R = [1, \"2*C\"]\nC = [5, 6, 7]");
  EXPECT_EQ(sweep.names, (std::vector<std::string>{"R", "C"}));
  RowMatrix expected(6, 2);
  expected << 1, 5, 1, 6, 1, 7, 12, 5, 12, 6, 12, 7;  // C = 3 R = 6 in the file
  EXPECT_EQ(sweep.values, expected);
  EXPECT_EQ(sweep.settings(4), (ParameterValues{{"R", 12}, {"C", 6}}));
  EXPECT_EQ(swept("R = [\"C\"]", {{"C", 9}}).values(0, 0), 9);
}

TEST(Sweep, RowsGoTogether) {
  RowMatrix expected(2, 2);
  expected << 1, 3, 2, 4;
  EXPECT_EQ(swept("T = [1, 2]\nR = [3, 4]\ncombine = \"rows\"").values, expected);
}

TEST(Sweep, RangesHaveBothEnds) {
  const Sweep linear = swept("R = {from = 1, to = 2, points = 5}");
  for (Index i = 0; i < 5; ++i) EXPECT_DOUBLE_EQ(linear.values(i, 0), 1 + 0.25 * double(i));
  const Sweep log = swept("R = {from = 1e-3, to = 1e3, points = 7, log = true}");
  for (Index i = 0; i < 7; ++i) EXPECT_NEAR(log.values(i, 0) / std::pow(10, double(i - 3)), 1, 1e-14);
  EXPECT_EQ(log.values(6, 0), 1e3);
  EXPECT_EQ(swept("R = {from = 4, to = 9, points = 1}").values(0, 0), 4);
}

// Mean and variance within five standard errors; the same numbers for the same seed, whatever else is drawn.
TEST(Sweep, DrawsHaveTheirLaw) {
  const std::string of_R = "R = {uniform = [1, 3]}\ndraws = 4000\n";
  const Sweep sweep = swept(of_R + "C = {normal = [10, 2]}\nT = {log_uniform = [0.1, 10]}\nseed = 5");
  ASSERT_EQ(sweep.scenes(), 4000);
  const auto moments = [&](Index c, bool log) {
    Vector v = sweep.values.col(c);
    if (log) v = v.array().log();
    return std::pair(v.mean(), (v.array() - v.mean()).square().mean());
  };
  const double n = 4000;
  EXPECT_NEAR(moments(0, false).first, 2, 5 * std::sqrt(1 / (3 * n)));
  EXPECT_NEAR(moments(0, false).second, 1.0 / 3, 5 * std::sqrt(4.0 / (45 * n)));
  EXPECT_NEAR(moments(1, false).first, 10, 5 * std::sqrt(4 / n));
  EXPECT_NEAR(moments(1, false).second, 4, 5 * std::sqrt(2 * 16 / n));
  EXPECT_NEAR(moments(2, true).first, 0, 5 * std::log(10) / std::sqrt(3 * n));
  EXPECT_GE(sweep.values.col(2).minCoeff(), 0.1);
  EXPECT_LE(sweep.values.col(2).maxCoeff(), 10);
  EXPECT_EQ(swept(of_R + "seed = 5").values, sweep.values.leftCols(1));
  EXPECT_NE(swept(of_R + "seed = 6").values, sweep.values.leftCols(1));
}

TEST(Sweep, TablesAreAnAxis) {
  const fs::path folder = fs::path(testing::TempDir()) / ("bromwich_sweep_" + std::to_string(::getpid()));
  fs::create_directories(folder);
  std::ofstream(folder / "v.csv") << "C, T\n1,2\n3,4\n";
  RowMatrix expected(4, 3);
  expected << 8, 1, 2, 8, 3, 4, 9, 1, 2, 9, 3, 4;
  const Sweep sweep = swept("R = [8, 9]\nfile = \"v.csv\"", {}, folder);
  EXPECT_EQ(sweep.names, (std::vector<std::string>{"R", "C", "T"}));
  EXPECT_EQ(sweep.values, expected);
  std::ofstream(folder / "bad.csv") << "C,Q\n1,2\n";
  EXPECT_NE(refused("file = \"bad.csv\"", folder).find("bad.csv:1: 'Q' is no parameter"), std::string::npos);
  std::ofstream(folder / "wide.csv") << "C\n1,2\n";
  EXPECT_NE(refused("file = \"wide.csv\"", folder).find("has 1 names and 2 columns"), std::string::npos);
  EXPECT_NE(refused("C = [1]\nfile = \"v.csv\"", folder).find("'C' is given twice"), std::string::npos);
  EXPECT_NE(refused("file = \"none.csv\"", folder), "nothing was refused");
}

TEST(Sweep, AFileWithoutOneHasNone) { EXPECT_FALSE(parse_sweep(head.substr(0, head.find("[sweep]")), "s.toml")); }

TEST(Sweep, MistakesAreRefused) {
  const std::vector<Refused> cases{
      {"Rr = [1]", "s.toml:15: sweep.Rr: 'Rr' is no parameter; use one of R, C, T"},
      {"steps = [10, 20]", "s.toml:15: sweep.steps: 'steps' is no parameter"},
      {"R = 1", "s.toml:15: sweep.R: found 1; give a list"},
      {"R = []", "s.toml:15: sweep.R: found an empty list"},
      {"R = [true]", "s.toml:15: sweep.R: found true"},
      {"R = {from = 1, to = 2}", "s.toml:15: sweep.R: has no 'points'"},
      {"R = {from = 1, to = 2, points = 2.5}", "s.toml:15: sweep.R: found points = 2.5"},
      {"R = {from = -1, to = 2, points = 2, log = true}", "s.toml:15: sweep.R: found log = true from -1 to 2"},
      {"R = {from = 1, to = 2, point = 2}", "s.toml:15: sweep.R: has the key 'point' (did you mean 'points'?)"},
      {"R = {uniform = [1, 2]}", "s.toml:14: sweep.draws: is missing"},
      {"R = [1]\ndraws = 3", "s.toml:16: sweep.draws: is given without a parameter to draw"},
      {"R = {uniform = [2, 1]}\ndraws = 3", "s.toml:15: sweep.R: found uniform = [2, 1]"},
      {"R = {log_uniform = [0, 1]}\ndraws = 3", "s.toml:15: sweep.R: found log_uniform = [0, 1]"},
      {"R = {normal = [1]}\ndraws = 3", "s.toml:15: sweep.R: normal has not two numbers"},
      {"R = {normal = [0, 1]}\ndraws = 3\nseed = 0.5", "s.toml:17: sweep.seed: found 0.5"},
      {"R = [1, 2]\nC = [1]\ncombine = \"rows\"",
       "s.toml:17: sweep.combine: found rows, and C has 1 values where R has 2"},
      {"R = [1]\ncombine = \"zip\"", "s.toml:16: sweep.combine: found 'zip'"},
      {"R = {from = 1, to = 2, points = 9999}\nC = {from = 1, to = 2, points = 9999}",
       "s.toml:14: sweep.combine: the product has 1e+08 scenes"}};
  for (const Refused& c : cases) EXPECT_EQ(refused(c.text).substr(0, c.message.size()), c.message) << c.text;
}

}  // namespace
}  // namespace bromwich
