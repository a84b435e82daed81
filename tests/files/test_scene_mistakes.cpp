// Mistakes in scene files: every one gives one line that names file, line and key.

#include "core/base/error.hpp"
#include "core/scene/relay.hpp"
#include "tests/files/small_scene.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <thread>
#include <vector>

namespace bromwich::scene_file_test {
namespace {

TEST(SceneFile, SettingsThatAreNoParametersAreRefused) {
  const auto set = [](const ParameterValues& settings) {
    return refusal([&] { parse(lines(small_scene), settings); });
  };
  EXPECT_EQ(set({{"r", 1}}), "--set: 'r' is no parameter of my.toml (did you mean 'R'?); use one of R, C, T, steps");
  EXPECT_EQ(set({{"T", -1}}), "--set: is -1; give a positive finite number");
  EXPECT_EQ(set({{"steps", 0.5}}), "--set: steps is 0.5; give a whole number from 1 to 16777216");
  EXPECT_EQ(set({{"R", NAN}}), "--set: R is nan; give a finite number");
  EXPECT_EQ(set({{"C", 0}}),
            "my.toml:5: dynamics.A: '-1/C' is infinite; check the divisions in it and the values of the parameters");
}

// Messages name file, line and key, and say what to do.
void expect_refused(const std::vector<Refused>& cases) {
  for (const Refused& bad : cases) {
    const std::string found = refusal([&] { parse(bad.text); });
    EXPECT_TRUE(found.starts_with(bad.message)) << found << "\nexpected: " << bad.message;
    EXPECT_EQ(found.find('\n'), std::string::npos) << found;
    EXPECT_NE(found.find("; "), std::string::npos) << found;  // what to do
  }
}

TEST(SceneFile, MistakesInTheFormNameFileLineAndKey) {
  const std::string without_x0 = with(7, "");
  expect_refused({
      // TOML itself
      {with(6, "B = [[1"), "my.toml:7: "},
      {with(6, "B = [[1]]\nB = [[2]]"), "my.toml:7: "},
      {with(4, "[dynamics"), "my.toml:4: "},
      {"\xff", "my.toml:1: "},
      // sections and keys
      {"", "my.toml:1: dynamics.A: is missing"},
      {with(0, "[outputs]"), "my.toml:13: outputs: is no known section (did you mean 'output'?)"},
      {"nme = \"x\"\n" + lines(small_scene), "my.toml:1: nme: is no known key (did you mean 'name'?)"},
      {with(7, "x_0 = [3]"),
       "my.toml:7: dynamics.x_0: is no known key (did you mean 'x0'?); use one of A, B, E, f, F, x0"},
      {with(12, "Time = 2"), "my.toml:12: time.Time: is no known key"},
      {with(12, "dt = 1e-3"), "my.toml:12: time.dt: is no known key (did you mean 'steps'?)"},
      {with(12, "t_final = 2"), "my.toml:12: time.t_final: is no known key (did you mean 'T'?)"},
      {with(9, "C = [[1]]"), "my.toml:9: complementarity.C: is no known key (did you mean 'N'?)"},
      {with(12, "include = \"a.toml\""), "my.toml:12: time.include: is no known key; move it to the head of the file"},
      {with(9, ""), "my.toml:8: complementarity.N: is missing"},
      {with(12, ""), "my.toml:11: time.T: is missing; add T = ... to [time]"},
      {"dynamics = 3\n", "my.toml:1: dynamics: found 3; write a section [dynamics]"},
      {with(4, "[[dynamics]]"), "my.toml:4: dynamics: found a list; write a section [dynamics]"},
      // boundary values instead of x0, free unknowns
      {with(0, "[boundary]\nE0 = [[1]]\nb = [1]"),
       "my.toml:7: dynamics.x0: is given with a section [boundary]; give one of the two"},
      {without_x0 + "[boundary]\nb = [1]", "my.toml:13: boundary.E0: found neither E0 nor ET"},
      {without_x0 + "[boundary]\nE0 = [[1]]", "my.toml:13: boundary.b: is missing"},
      {without_x0 + "[boundary]\nE0 = [[1, 2]]\nb = [1]", "my.toml:14: boundary.E0: is 1 x 2; give 1 x 1"},
      {without_x0 + "[boundary]\nET = [[\"R\"], [1]]\nb = [1]", "my.toml:14: boundary.ET: is 2 x 1; give 1 x 1"},
      {without_x0 + "[boundary]\nET = [[1]]\nb = [1, 2]", "my.toml:15: boundary.b: has 2 entries; give 1"},
      {without_x0 + "[boundary]\nE1 = [[1]]", "my.toml:14: boundary.E1: is no known key (did you mean 'E0'?)"},
      {without_x0, "my.toml:4: dynamics.x0: is missing"},
      {with(0, "[free]"), "my.toml:13: free.rows: is missing"},
      {with(0, "[free]\nrows = [0.5]"), "my.toml:14: free.rows: found 0.5; give whole numbers"},
      {with(0, "[free]\nrows = [1]"), "my.toml:14: free.rows: row 1 of 1; rows are counted from 0"},
      {with(0, "[free]\nrows = [0, 0]"), "my.toml:14: free.rows: row 0 after row 0; give each row once"},
      {with(0, "[relay]\nC = [[1]]"),
       "my.toml:6: dynamics.B: has 0 columns for y; give one for each of the 1 rows of N"},
      {"name = 3\n" + lines(small_scene), "my.toml:1: name: found 3; give a text in quotes"},
  });
}

TEST(SceneFile, MistakesInParametersAndMatricesNameFileLineAndKey) {
  expect_refused({
      // parameters
      {with(2, "R = \"C\""), "my.toml:2: parameters.R: 'C' uses 'C', which is not defined"},
      {with(2, "R = true"), "my.toml:2: parameters.R: found true; give a finite number"},
      {with(2, "R = inf"), "my.toml:2: parameters.R: found inf; give a finite number"},
      {with(2, "R = 1979-05-27"), "my.toml:2: parameters.R: found a date or time"},
      {with(2, "t = 2"), "my.toml:2: parameters.t: 't' already has a meaning"},
      {with(2, "sin = 2"), "my.toml:2: parameters.sin: 'sin' already has a meaning"},
      {with(2, "\"a b\" = 2"), "my.toml:2: parameters.a b: 'a b' cannot be used in expressions"},
      {with(3, "C = \"t\""), "my.toml:3: parameters.C: 't' depends on the time t"},
      // matrices
      {with(5, "A = 1"), "my.toml:5: dynamics.A: found 1; give rows of numbers"},
      {with(5, "A = \"1/C\""), "my.toml:5: dynamics.A: found the text '1/C'; give rows of numbers"},
      {with(5, "A = [1]"), "my.toml:5: dynamics.A: row 0 is 1; give rows of numbers"},
      {with(5, "A = []"), "my.toml:5: dynamics.A: has no rows"},
      {with(5, "A = [[1, 2],\n [3]]"),
       "my.toml:6: dynamics.A: row 0 has 2 entries and row 1 has 1; give rows of equal"},
      {with(5, "A = [[1, 2],\n [3, \"x\"]]"), "my.toml:6: dynamics.A: 'x' uses 'x', which is not defined"},
      {with(5, "A = [[1, 2]]"), "my.toml:5: dynamics.A: is 1 x 2; make it square"},
      {with(5, "A = [[nan]]"), "my.toml:5: dynamics.A: found nan"},
      {with(5, "A = [[[1]]]"), "my.toml:5: dynamics.A: found a list; give a finite number"},
      {with(6, "B = [[1], [2]]"), "my.toml:6: dynamics.B: is 2 x 1; make it states x constraints = 1 x 1"},
      {with(9, "N = [[1, 2]]"), "my.toml:9: complementarity.N: is 1 x 2; make it constraints x states = 1 x 1"},
      {with(10, "M = [[1, 0], [0, 1]]"), "my.toml:10: complementarity.M: is 2 x 2; make it constraints x constraints"},
      {with(10, "M = [[1]]\nclass = \"Q\""), "my.toml:11: complementarity.class: found 'Q'"},
      {with(5, "A = \"missing.mtx\""), "my.toml:5: dynamics.A: the file 'missing.mtx' does not exist"},
  });
}

TEST(SceneFile, MistakesInFunctionsAndTimesNameFileLineAndKey) {
  expect_refused({
      // vectors and functions
      {with(7, "x0 = true"), "my.toml:7: dynamics.x0: found true; give a list"},
      {with(7, "x0 = [3, 4]"), "my.toml:7: dynamics.x0: has 2 entries; give 1, one per state"},
      {with(7, "x0 = [\"1/0\"]"), "my.toml:7: dynamics.x0: '1/0' is infinite"},
      {with(7, "x0 = [3]\nf = true"), "my.toml:8: dynamics.f: found true; give a list of expressions"},
      {with(7, "x0 = [3]\nf = \"sin(k*t)\""), "my.toml:8: dynamics.f: 'sin(k*t)' uses 'k', which is not defined"},
      {with(7, "x0 = [3]\nf = [\"sin(t)\", 0]"), "my.toml:8: dynamics.f: has 2 entries; give 1, one per state"},
      {with(7, "x0 = [3]\nf = [\"sin(t\"]"), "my.toml:8: dynamics.f: 'sin(t' is no expression"},
      {with(7, "x0 = [3]\nf = [\"1/t\"]"), "my.toml:8: dynamics.f: entry (0) is inf"},
      {with(7, "x0 = [3]\nF = [[1]]"), "my.toml:8: dynamics.F: is given without f"},
      {with(7, "x0 = [3]\nf = [\"t\"]\nF = [[1, 2]]"),
       "my.toml:8: dynamics.f: has 1 entries; give 2, one per column of F"},
      {with(7, "x0 = [3]\nf = [\"t\"]\nF = [[1], [2]]"), "my.toml:9: dynamics.F: has 2 rows; give 1, one per state"},
      {with(10, "M = [[1]]\ng = [0, 0]"), "my.toml:11: complementarity.g: has 2 entries; give 1, one per constraint"},
      {with(10, "M = [[1]]\ng = [\"log(t)\"]"), "my.toml:11: complementarity.g: entry (0) is -inf"},
      // time, output, what is known
      {with(12, "T = -1"), "my.toml:12: time.T: is -1; give a positive finite number"},
      {with(12, "T = 2\nsteps = 0"), "my.toml:13: time.steps: found 0; give a whole number from 1 to 16777216"},
      {with(12, "T = 2\nsteps = 2.5"), "my.toml:13: time.steps: found 2.5; give a whole number"},
      {with(0, "[output]\nstates = \"1\""), "my.toml:14: output.states: found '1'; give all, none"},
      {with(0, "[output]\nstates = [0]"), "my.toml:14: output.states: found a list; give a text in quotes"},
      {with(0, "[exact]\nx = [\"t\", 0]"), "my.toml:14: exact.x: has 2 entries; give 1, one per state"},
      {with(0, "[exact]"), "my.toml:13: exact.x: found neither x nor y"},
      {with(0, "[reference]\nx = [1]"), "my.toml:13: reference.t: is missing"},
      {with(0, "[reference]\nt = 3\nx = [1]"), "my.toml:14: reference.t: found 3; give 0 to T = 2"},
      {with(0, "[reference]\nt = 1\ny = [1, 2]"), "my.toml:15: reference.y: has 2 entries; give 1"},
      {with(0, "[reference]\ntolerance = 0"), "my.toml:14: reference.tolerance: found 0; give a positive number"},
      {with(0, "[reference]\nstatus = \"done\""), "my.toml:14: reference.status: found 'done'; use one of solved"},
  });
}

TEST(SceneFile, ZWithAPositiveOffDiagonalEntryIsRefusedAtItsLine) {
  const std::string text =
      "[dynamics]\nA = [[-1]]\nB = [[1, 1]]\nx0 = [0]\n[complementarity]\nN = [[1], [1]]\nM = [[1, 1], [0, 1]]\nclass "
      "= "
      "\"Z\"\n[time]\nT = 1\n";
  EXPECT_TRUE(refusal([&] { parse(text); }).starts_with("my.toml:8: complementarity.class: says Z"));
}

TEST(SceneFile, RelayMistakesNameTheirKey) {
  const std::string head = "[dynamics]\nA = [[0, 1], [-2, -3]]\n", tail = "x0 = [1, 0]\n[relay]\n",
                    end = "[time]\nT = 1\n";
  const auto refused = [&](const std::string& B, const std::string& C) {
    return refusal([&] { parse(head + B + tail + C + end); });
  };
  EXPECT_TRUE(refused("B = [[1]]\n", "C = [[1, 1]]\n").starts_with("my.toml:3: dynamics.B: is 1 x 1"));
  EXPECT_TRUE(refused("B = [[1], [1]]\n", "C = [[1]]\n").starts_with("my.toml:6: relay.C: is 1 x 1"));
  EXPECT_TRUE(refused("B = [[1], [1]]\n", "").starts_with("my.toml:5: relay.C: is missing"));
}

TEST(SceneFile, SaysWhereAPortHamiltonianSceneIsWrong) {
  const auto refused = [](const std::string& from, const std::string& to) {
    std::string text = toy_port;
    if (from.empty())
      text += to;
    else
      text.replace(text.find(from), from.size(), to);
    return refusal([&] { parse(text); });
  };
  for (const auto& [line, begin] : std::vector<std::pair<std::string, std::string>>{
           {refused("J = [[0, 0, 1]", "J = [[0, 0, 2]"), "my.toml:2: port.J: is not skew-symmetric: entry (2,0) is -1"},
           {refused("R = [[1, 1, 0]", "R = [[-1, 1, 0]"), "my.toml:3: port.R: is not positive semidefinite"},
           {refused("B = [[1], [1], [0]]", "B = [[1], [1]]"), "my.toml:4: port.B: has 2 rows"},
           {refused("u = [", "u = [\"t\", "), "my.toml:5: port.u: has 2 entries; give 1, one per column of B"},
           {refused("x0 = [1, 2, 1]", "x0 = [1, 2]"), "my.toml:6: port.x0: has 2 entries"},
           {refused("x0 =", "E = [[1,0,0],[0,1,0],[0,0,0]]\nx0 ="), "my.toml:6: port.E: is singular, of rank 2 of 3"},
           {refused("x0 =", "K = 1\nx0 ="), "my.toml:6: port.K: is no known key"},
           {refused("", "[dynamics]\nA = [[1]]\n"), "my.toml:11: dynamics.A: is given with a section [port]"},
           {refused("", "[dynamics]\nB = [[1], [0], [0]]\n"),
            "my.toml:11: dynamics.B: is given without [complementarity]"},
           {refused("", "[relay]\nC = [[1]]\n"), "my.toml:11: relay.C: is given with [port]"}})
    EXPECT_TRUE(line.starts_with(begin)) << line << "\nshould begin with\n" << begin;
}

TEST(SceneFile, SaysWhereASourceSwitchesTooOften) {
  const SceneFile file = parse(with(7, "x0 = [3]\nf = [\"sign(sin(1e9*t))\"]"));
  EXPECT_NE(file.warning.find("declare them as jumps"), std::string::npos) << file.warning;
}

}  // namespace
}  // namespace bromwich::scene_file_test
