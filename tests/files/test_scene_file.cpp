// Scene files: a scene in TOML is the same problem as the built-in one.

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

// Above 2^53 not every integer is a double; the nearest one is meant.
TEST(SceneFile, LargeWholeNumbersAreNumbers) {
  const Scene scene = parse(
                          "[dynamics]\nA = [[-1]]\nB = [[21321961620469081]]\nx0 = [0]\n[complementarity]\n"
                          "N = [[1]]\nM = [[1]]\n[time]\nT = 1\n")
                          .scene;
  EXPECT_EQ(get<DenseDynamics>(scene.dynamics).B(0, 0), 21321961620469080.0);
}

TEST(SceneFile, ReadsAMassMatrix) {
  EXPECT_EQ(dense(parse(lines(small_scene))).E.size(), 0);
  const SceneFile file = parse(with(7, "x0 = [3]\nE = [[\"2*R\"]]"));
  EXPECT_EQ(dense(file).E, Matrix{{4}});
  const std::string refused = refusal([] { parse(with(7, "x0 = [3]\nE = [[1, 0]]")); });
  EXPECT_TRUE(refused.starts_with("my.toml:8: dynamics.E")) << refused;
}

TEST(SceneFile, OneNumberIsThatOfAllEntries) {
  const Scene scene = parse(
                          "[dynamics]\nA = \"tridiag(3, 1, -2, 1)\"\nB = \"identity(3)\"\nx0 = 0.5\nf = 2\n"
                          "[complementarity]\nN = \"identity(3)\"\nM = 1\ng = -1\n[time]\nT = 1\n")
                          .scene;
  EXPECT_EQ(scene.x0, Vector::Constant(3, 0.5));
  Vector f(3), g(3);
  scene.f(0.3, f), scene.g(0.3, g);
  EXPECT_EQ(f, Vector::Constant(3, 2));
  EXPECT_EQ(g, Vector::Constant(3, -1));
}

TEST(SceneFile, NameAndStepsHaveDefaults) {
  const SceneFile file = parse_scene(lines(small_scene), "folder/rc.toml");
  EXPECT_EQ(file.scene.name, "rc");
  EXPECT_EQ(file.scene.default_steps, 0);
  EXPECT_EQ(file.states, "none");
}

TEST(SceneFile, SettingsReplaceParametersAndWhatFollowsFromThem) {
  EXPECT_EQ(dense(parse(lines(small_scene), {{"R", 8}})).A, (Matrix{{-16}}));  // C = 1/16
  const SceneFile both = parse(lines(small_scene), {{"R", 8}, {"C", 0.5}});
  EXPECT_EQ(dense(both).A, (Matrix{{-2}}));
  EXPECT_EQ(to_dense(both.scene.M), (Matrix{{8}}));
  EXPECT_EQ(both.parameters, (ParameterValues{{"R", 8}, {"C", 0.5}}));
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

}  // namespace
}  // namespace bromwich::scene_file_test
