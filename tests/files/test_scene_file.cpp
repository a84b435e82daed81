// Scene files: a scene in TOML is the same problem as the built-in one, and every mistake gives one line that names
// file, line and key.

#include "core/base/error.hpp"
#include "core/scene/relay.hpp"
#include "files/scene_file.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <thread>
#include <vector>

namespace bromwich {
namespace {

/// One state, one constraint; tests replace single lines. Lines count from 1.
const std::vector<std::string> small_scene{
    "[parameters]",       // 1
    "R = 2",              // 2
    "C = \"1/(2*R)\"",    // 3
    "[dynamics]",         // 4
    "A = [[\"-1/C\"]]",   // 5
    "B = [[1]]",          // 6
    "x0 = [3]",           // 7
    "[complementarity]",  // 8
    "N = [[1]]",          // 9
    "M = [[\"R\"]]",      // 10
    "[time]",             // 11
    "T = 2",              // 12
};

std::string lines(const std::vector<std::string>& all) {
  std::string text;
  for (const std::string& line : all) text += line + "\n";
  return text;
}

/// small_scene with line `number` (from 1) replaced; 0 appends.
std::string with(std::size_t number, const std::string& line) {
  auto all = small_scene;
  if (number > 0)
    all[number - 1] = line;
  else
    all.push_back(line);
  return lines(all);
}

SceneFile parse(const std::string& text, const ParameterValues& settings = {}) {
  return parse_scene(text, "my.toml", {}, settings);
}

const DenseDynamics& dense(const SceneFile& file) { return get<DenseDynamics>(file.scene.dynamics); }

TEST(SceneFile, ReadsBoundaryValuesAndFreeRows) {
  const Scene scene = parse(with(7, "") + "[boundary]\nE0 = [[\"1/R\"]]\nb = [\"-R\"]\n[free]\nrows = [0]\n").scene;
  ASSERT_TRUE(scene.boundary);
  EXPECT_EQ(scene.boundary->E0, Matrix{{0.5}});
  EXPECT_EQ(scene.boundary->ET, Matrix{{0}}) << "left out: 0";
  EXPECT_EQ(scene.boundary->b, Vector{{-2}});
  EXPECT_EQ(scene.x0.size(), 0);
  EXPECT_EQ(scene.free_rows, std::vector<Index>{0});
  EXPECT_FALSE(parse(with(0, "")).scene.boundary);
}

TEST(SceneFile, RelaysTakeBoundaryValuesToo) {
  const Scene scene = parse(
                          "[dynamics]\nA = [[0]]\nB = [[1]]\n[relay]\nC = [[1]]\n[boundary]\nE0 = [[1]]\n"
                          "ET = [[-1]]\nb = [0]\n[time]\nT = 1\n")
                          .scene;
  ASSERT_TRUE(scene.boundary);
  EXPECT_EQ(scene.boundary->ET, Matrix{{-1}});
  EXPECT_EQ(scene.x0.size(), 0);
  EXPECT_EQ(scene.constraints(), 2);
}

TEST(SceneFile, ReadsWhatIsWritten) {
  const SceneFile file =
      parse("name = \"rc\"\ndescription = \"one\\ncell\"\n" + with(0, "steps = 50\n[output]\nstates = \"0\""));
  EXPECT_EQ(file.scene.name, "rc");
  EXPECT_EQ(file.description, "one cell");
  EXPECT_EQ(dense(file).A, (Matrix{{-4}}));
  EXPECT_EQ(to_dense(file.scene.M), (Matrix{{2}}));
  EXPECT_EQ(file.scene.x0, Vector::Constant(1, 3));
  EXPECT_EQ(file.scene.T, 2);
  EXPECT_EQ(file.scene.default_steps, 50);
  EXPECT_EQ(file.states, "0");
  EXPECT_EQ(file.parameters, (ParameterValues{{"R", 2}, {"C", 0.25}}));
  EXPECT_FALSE(file.scene.f);
  EXPECT_FALSE(file.scene.g);
  EXPECT_FALSE(file.scene.exact);
  EXPECT_FALSE(file.reference);
}

TEST(SceneFile, ReadsAMassMatrix) {
  EXPECT_EQ(dense(parse(lines(small_scene))).E.size(), 0);
  const SceneFile file = parse(with(7, "x0 = [3]\nE = [[\"2*R\"]]"));
  EXPECT_EQ(dense(file).E, Matrix{{4}});
  const std::string refused = refusal([] { parse(with(7, "x0 = [3]\nE = [[1, 0]]")); });
  EXPECT_TRUE(refused.starts_with("my.toml:8: dynamics.E")) << refused;
}

TEST(SceneFile, NameAndStepsHaveDefaults) {
  const SceneFile file = parse_scene(lines(small_scene), "folder/rc.toml");
  EXPECT_EQ(file.scene.name, "rc");
  EXPECT_EQ(file.scene.default_steps, Scene{}.default_steps);
  EXPECT_EQ(file.states, "none");
}

TEST(SceneFile, SettingsReplaceParametersAndWhatFollowsFromThem) {
  EXPECT_EQ(dense(parse(lines(small_scene), {{"R", 8}})).A, (Matrix{{-16}}));  // C = 1/16
  const SceneFile both = parse(lines(small_scene), {{"R", 8}, {"C", 0.5}});
  EXPECT_EQ(dense(both).A, (Matrix{{-2}}));
  EXPECT_EQ(to_dense(both.scene.M), (Matrix{{8}}));
  EXPECT_EQ(both.parameters, (ParameterValues{{"R", 8}, {"C", 0.5}}));
}

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

TEST(SceneFile, ClassIsPassedOn) {
  const auto read = [](const std::string& word) {
    return parse(with(10, "M = [[1]]\nclass = \"" + word + "\"")).scene.lcp_class;
  };
  EXPECT_EQ(read("auto"), LcpClass::automatic);
  EXPECT_EQ(read("P"), LcpClass::P);
  EXPECT_EQ(read("Z"), LcpClass::Z);
  EXPECT_EQ(read("PSD"), LcpClass::PSD);
}

TEST(SceneFile, MistakesNameFileLineAndKey) {
  const std::string without_x0 = with(7, "");
  const std::vector<Refused> cases{
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
      {with(0, "[relay]\nC = [[1]]"), "my.toml:14: relay.C: found [relay] and [complementarity]; give one of the two"},
      {"name = 3\n" + lines(small_scene), "my.toml:1: name: found 3; give a text in quotes"},
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
      // vectors and functions
      {with(7, "x0 = 3"), "my.toml:7: dynamics.x0: found 3; give a list"},
      {with(7, "x0 = [3, 4]"), "my.toml:7: dynamics.x0: has 2 entries; give 1, one per state"},
      {with(7, "x0 = [\"1/0\"]"), "my.toml:7: dynamics.x0: '1/0' is infinite"},
      {with(7, "x0 = [3]\nf = 3"), "my.toml:8: dynamics.f: found 3; give a list of expressions"},
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
  };
  for (const Refused& bad : cases) {
    const std::string found = refusal([&] { parse(bad.text); });
    EXPECT_TRUE(found.starts_with(bad.message)) << found << "\nexpected: " << bad.message;
    EXPECT_EQ(found.find('\n'), std::string::npos) << found;
    EXPECT_NE(found.find("; "), std::string::npos) << found;  // what to do
  }
}

TEST(SceneFile, ZWithAPositiveOffDiagonalEntryIsRefusedAtItsLine) {
  const std::string text =
      "[dynamics]\nA = [[-1]]\nB = [[1, 1]]\nx0 = [0]\n[complementarity]\nN = [[1], [1]]\nM = [[1, 1], [0, 1]]\nclass "
      "= "
      "\"Z\"\n[time]\nT = 1\n";
  EXPECT_TRUE(refusal([&] { parse(text); }).starts_with("my.toml:8: complementarity.class: says Z"));
}

const std::string bridge = R"toml(
[parameters]
nu = 1
[dynamics]
A = [[0, 1], [-4, 0]]
B = [[0], [-3]]
f = [0, "sin(4*t)"]
x0 = [0, "nu"]
[complementarity]
N = [[1, 0]]
M = [[1]]
class = "P"
[time]
T = "3*pi"
steps = 600
)toml";

const std::string dlcp_small = R"toml(
[dynamics]
A = [[-2, 1, 0], [1, -2, 1.5], [0, -1, -2]]
B = [[-1, -4, -2, 0], [-3, -2, -2, 0], [-3, -3, 0, 3]]
x0 = [1, 1, 1]
# x' - A x - B y with x = (exp(-t), cos(2 t), 1 + t), S = sin(3 pi t), y = (0, S+/2, 0, (-S-0.3)+/4)
f = [
  "-exp(-t) + 2*exp(-t) - cos(2*t) + 4*max(sin(3*pi*t), 0)/2",
  "-2*sin(2*t) - exp(-t) + 2*cos(2*t) - 1.5*(1 + t) + 2*max(sin(3*pi*t), 0)/2",
  "1 + cos(2*t) + 2*(1 + t) + 3*max(sin(3*pi*t), 0)/2 - 3*max(-sin(3*pi*t) - 0.3, 0)/4",
]
[complementarity]
N = [[0, 0, -1], [-2, -2, 1.5], [-0.5, -1, -0.5], [1, 2.5, 1.5]]
M = [["2/3", -1, "-1/3", "-5/3"], ["-2/3", "1/3", "-2/3", "-4/3"], ["-2/3", "-1/30", 0, "-5/3"], [-1, 0, "-5/3", "1/3"]]
class = "Z"
# w - N x - M y with w = (0.15 + t exp(-t), S-, 0.15 + t exp(-t/3), (S + 0.3)+)
g = [
  "0.15 + t*exp(-t) + 1 + t + max(sin(3*pi*t), 0)/2 + 5/3*max(-sin(3*pi*t) - 0.3, 0)/4",
  "max(-sin(3*pi*t), 0) + 2*exp(-t) + 2*cos(2*t) - 1.5*(1 + t) - max(sin(3*pi*t), 0)/6 + max(-sin(3*pi*t) - 0.3, 0)/3",
  "0.15 + t*exp(-t/3) + exp(-t)/2 + cos(2*t) + (1 + t)/2 + max(sin(3*pi*t), 0)/60 + 5/3*max(-sin(3*pi*t) - 0.3, 0)/4",
  "max(sin(3*pi*t) + 0.3, 0) - exp(-t) - 2.5*cos(2*t) - 1.5*(1 + t) - max(-sin(3*pi*t) - 0.3, 0)/12",
]
[time]
T = 1
steps = 400
)toml";

// The matrices are the same doubles. The sources differ by rounding (1e-15 of terms of size 10), which the problem
// amplifies no more than the kernel's own error.
TEST(SceneFile, BridgeInTomlIsTheBuiltInOne) {
  for (const Method method : {Method::march, Method::euler})
    EXPECT_LT(distance(solved_y(parse(bridge).scene, method, 600), solved_y(make_scene("bridge"), method, 600)),
              same_problem)
        << to_string(method);
}

TEST(SceneFile, DlcpSmallInTomlIsTheBuiltInOne) {
  Scene scene = parse(dlcp_small).scene;
  EXPECT_FALSE(scene.breakpoints.empty()) << "the kinks of its sources";
  scene.breakpoints.clear();  // the built-in one does not name them
  for (const Method method : {Method::march, Method::euler})
    EXPECT_LT(distance(solved_y(scene, method, 400), solved_y(make_scene("dlcp-small"), method, 400)), same_problem)
        << to_string(method);
}

TEST(SceneFile, SourcesThroughFAddUpToThoseOfTheState) {
  const std::string through = bridge.substr(0, bridge.find("f = ")) +
                              "f = [\"sin(4*t)/2\", \"sin(4*t)/4\"]\nF = [[0, 0], [1, 2]]\n" +
                              bridge.substr(bridge.find("x0 = "));
  const Scene scene = parse(through).scene;
  ASSERT_EQ(scene.f_entry, SourceEntry::through_F);
  EXPECT_EQ(scene.sources(), 2);
  EXPECT_EQ(Matrix(scene.F), (Matrix{{0, 0}, {1, 2}}));
  EXPECT_LT(distance(solved_y(scene, Method::march, 100), solved_y(make_scene("bridge"), Method::march, 100)),
            same_problem);
}

TEST(SceneFile, RelayBecomesAComplementaritySystem) {
  const std::string text =
      "[dynamics]\nA = [[0, 1], [-2, -3]]\nB = [[0], [1]]\nx0 = [1, 0]\nf = [\"t\", \"2*t\"]\n[relay]\nC = [[1, 1]]\n"
      "[time]\nT = 1\n";
  const Scene scene = parse(text).scene;
  const Scene expected = relay_scene(
      Matrix{{0, 1}, {-2, -3}}, Matrix{{0}, {1}}, Matrix{{1, 1}}, [](double t, Eigen::Ref<Vector> f) { f << t, 2 * t; },
      Vector{{1, 0}});
  EXPECT_EQ(to_dense(scene.dynamics).B, to_dense(expected.dynamics).B);
  EXPECT_EQ(to_dense(scene.dynamics).N, to_dense(expected.dynamics).N);
  EXPECT_EQ(to_dense(scene.M), to_dense(expected.M));
  EXPECT_EQ(scene.lcp_class, LcpClass::PSD);
  EXPECT_EQ(oracle::value(scene.f, 0.5, 2), oracle::value(expected.f, 0.5, 2));
  EXPECT_EQ(oracle::value(scene.g, 0.5, 2), oracle::value(expected.g, 0.5, 2));
  // The same source through F, and without F.
  const std::string f = "f = [\"t\", \"2*t\"]\n";
  auto through = text, without = text;
  through.replace(through.find(f), f.size(), "f = [\"t\"]\nF = [[1], [2]]\n");
  without.replace(without.find(f), f.size(), "");
  EXPECT_EQ(oracle::value(parse(through).scene.f, 0.5, 2), oracle::value(expected.f, 0.5, 2));
  EXPECT_EQ(oracle::value(parse(without).scene.f, 0.5, 2), (Vector{{0, 1}}));
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

TEST(SceneFile, ExactSolutionsMayBeKnownInPart) {
  const SceneFile both = parse(with(0, "[exact]\nx = [\"3*exp(-4*t)\"]\ny = [0]"));
  Vector x(1), y(1);
  both.scene.exact(0.5, x, y);
  EXPECT_DOUBLE_EQ(x[0], 3 * std::exp(-2));
  EXPECT_EQ(y[0], 0);
  parse(with(0, "[exact]\ny = [\"t\"]")).scene.exact(0.5, x, y);
  EXPECT_TRUE(std::isnan(x[0]));
  EXPECT_EQ(y[0], 0.5);
}

TEST(SceneFile, ReferenceIsReadAsWritten) {
  const auto reference = parse(with(0,
                                    "[reference]\nt = \"T0\"\nx = [nan]\ny = [\"\"]\nstatus = \"infeasible\"\n"
                                    "infeasible_at = \"log(2)\"\ntolerance = 1e-6\nsource = \"by hand\""
                                    "\n")
                                   .replace(with(0, "").find("R = 2"), 5, "R = 2\nT0 = 1"))
                             .reference;
  ASSERT_TRUE(reference);
  EXPECT_EQ(reference->t, 1);
  ASSERT_EQ(reference->x.size(), 1u);
  EXPECT_TRUE(std::isnan(reference->x[0]));
  ASSERT_EQ(reference->y.size(), 1u);
  EXPECT_TRUE(std::isnan(reference->y[0]));
  EXPECT_EQ(reference->status, "infeasible");
  EXPECT_EQ(reference->infeasible_at, std::log(2.));
  EXPECT_EQ(reference->tolerance, 1e-6);
  EXPECT_EQ(reference->source, "by hand");
}

// Threads of several backends may sample one scene at once.
TEST(SceneFile, SourcesMayBeSampledByManyThreads) {
  const Scene scene = parse(dlcp_small).scene;
  const Scene built_in = make_scene("dlcp-small");
  std::vector<double> largest(8, 0);
  std::vector<std::thread> threads;
  for (std::size_t k = 0; k < largest.size(); ++k)
    threads.emplace_back([&, k] {
      for (int i = 0; i < 500; ++i) {
        const double t = (double(k) + i * 8.) / 4000;
        largest[k] = std::max(largest[k],
                              (oracle::value(scene.f, t, 3) - oracle::value(built_in.f, t, 3)).cwiseAbs().maxCoeff());
        largest[k] = std::max(largest[k],
                              (oracle::value(scene.g, t, 4) - oracle::value(built_in.g, t, 4)).cwiseAbs().maxCoeff());
      }
    });
  for (std::thread& thread : threads) thread.join();
  // Sums of up to 12 terms below 10: 12 * 10 * 2^-53 on either side.
  for (const double error : largest) EXPECT_LT(error, 3e-14);
}

const std::string toy_port =
    "[port]\n"                                   // 1
    "J = [[0, 0, 1], [0, 0, -1], [-1, 1, 0]]\n"  // 2
    "R = [[1, 1, 0], [1, 1, 0], [0, 0, 0]]\n"    // 3
    "B = [[1], [1], [0]]\n"                      // 4
    "u = [\"t > 5 ? 10 : 0\"]\n"                 // 5
    "x0 = [1, 2, 1]\n"                           // 6
    "[time]\nT = 10\nsteps = 200\n";             // 7 to 9

TEST(SceneFile, ReadsPortHamiltonianScenes) {
  const Scene scene = parse(toy_port).scene, built_in = make_scene("ph-toy");
  const auto &read = get<DenseDynamics>(scene.dynamics), &made = get<DenseDynamics>(built_in.dynamics);
  EXPECT_EQ(read.A, made.A);
  EXPECT_EQ(scene.constraints(), 0);
  EXPECT_EQ(Matrix(scene.F), Matrix(built_in.F));
  EXPECT_EQ(scene.x0, built_in.x0);
  EXPECT_EQ(oracle::value(scene.f, 5, 1), oracle::value(built_in.f, 5, 1));
  EXPECT_EQ(oracle::value(scene.f, 5.1, 1), oracle::value(built_in.f, 5.1, 1));
  ASSERT_TRUE(scene.port);

  const Scene clamped =
      parse(toy_port + "[dynamics]\nB = [[-1], [0], [0]]\n[complementarity]\nN = [[-1, 0, 0]]\nM = [[1]]\ng = [3]\n")
          .scene;
  EXPECT_EQ(clamped.constraints(), 1);
  EXPECT_EQ(get<DenseDynamics>(clamped.dynamics).B, (Matrix{{-1}, {0}, {0}}));
  EXPECT_EQ(oracle::value(clamped.g, 1, 1)[0], 3);
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

TEST(SceneFile, KnowsWhereItsSourcesSwitch) {
  EXPECT_TRUE(parse(with(0, "jumps = []")).scene.breakpoints.empty());
  EXPECT_TRUE(parse(with(7, "x0 = [3]\nf = [\"sin(t)\"]")).scene.breakpoints.empty());
  EXPECT_EQ(parse(with(7, "x0 = [3]\nf = [\"t > 1.25\"]")).scene.breakpoints.size(), 1u);
  const SceneFile both = parse(with(10, "M = [[1]]\ng = [\"abs(t - 0.5*R)\"]") + "jumps = [1.5, \"C\", 1.5]\n");
  ASSERT_EQ(both.scene.breakpoints.size(), 3u);
  EXPECT_EQ(both.scene.breakpoints[0], 0.25);
  EXPECT_NEAR(both.scene.breakpoints[1], 1, 1e-15);
  EXPECT_EQ(both.scene.breakpoints[2], 1.5);
  EXPECT_TRUE(both.warning.empty());
  const std::string line = refusal([] { parse(with(0, "jumps = [3]")); });
  EXPECT_TRUE(line.starts_with("my.toml:13: time.jumps: found 3; give times from 0 to T = 2")) << line;
}

TEST(SceneFile, SaysWhereASourceSwitchesTooOften) {
  const SceneFile file = parse(with(7, "x0 = [3]\nf = [\"sign(sin(1e9*t))\"]"));
  EXPECT_NE(file.warning.find("declare them as jumps"), std::string::npos) << file.warning;
}

}  // namespace
}  // namespace bromwich
