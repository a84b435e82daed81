// Sections and values of scene files that stand for longer ones: definitions, matrices and vectors by a word, offsets
// of relays, names and units. Each is compared with the scene written out.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/scene/component_names.hpp"
#include "tests/files/scene_texts.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace bromwich {
namespace {

TEST(SceneSections, MatricesByAWord) {
  const auto A = [](const std::string& word) {
    return dense_matrices(parse_sections(with_replaced(two_states, "[[-2, 1], [1, -2]]", "\"" + word + "\""))).A;
  };
  EXPECT_EQ(A("identity(2)"), (Matrix{{1, 0}, {0, 1}}));
  EXPECT_EQ(A(" identity ( 1 + 1 , -3 ) "), (Matrix{{-3, 0}, {0, -3}}));
  EXPECT_EQ(A("zero(2)"), (Matrix::Zero(2, 2)));
  EXPECT_EQ(A("zero(2, 2)"), (Matrix::Zero(2, 2)));
  EXPECT_EQ(A("tridiag(2, 3, -max(1, 2), sqrt(4))"), (Matrix{{-2, 2}, {3, -2}}));
  EXPECT_EQ(dense_matrices(parse_sections(with_replaced(two_states, "x0 =", "E = \"identity\"\nx0 ="))).E,
            (Matrix::Identity(2, 2)));
  EXPECT_EQ(to_dense(parse_sections(with_replaced(two_states, "M = [[1]]", "M = \"identity\"")).scene.M),
            (Matrix{{1}}));
  EXPECT_EQ(dense_matrices(parse_sections(with_replaced(two_states, "N = [[1, 0]]", "N = \"zero\""))).N,
            (Matrix{{0, 0}}));
  const auto with_A = [](const std::string& word) { return with_replaced(two_states, "[[-2, 1], [1, -2]]", word); };
  expect_refused_sections({
      {with_A("\"identity\""),
       "my.toml:2: dynamics.A: identity has no size, and it does not follow from other matrices; "
       "write identity(n)"},
      {with_A("\"identity(2.5)\""), "my.toml:2: dynamics.A: the size in identity is 2.5; give a whole number"},
      {with_A("\"zero(0)\""), "my.toml:2: dynamics.A: the size in zero is 0; give a whole number from 1"},
      {with_A("\"tridiag(2, 1, 1)\""), "my.toml:2: dynamics.A: tridiag has 3 arguments; write tridiag(n, lower,"},
      {with_A("\"identity(1, 2, 3)\""), "my.toml:2: dynamics.A: identity has 3 arguments; write identity(n)"},
      {with_A("\"eye(2)\""), "my.toml:2: dynamics.A: found the text 'eye(2)' (did you mean 'identity'?); give rows"},
      {with_A("\"tridiag(k, 1, 1, 1)\""), "my.toml:2: dynamics.A: 'k' uses 'k', which is not defined"},
      {with_A("\"identity(2\""), "my.toml:2: dynamics.A: found the text 'identity(2'"},
      {with_A("\"identity(3)\""), "my.toml:3: dynamics.B: is 2 x 1; make it states x constraints = 3 x 1"},
  });
}

TEST(SceneSections, ALargeTridiagonalMatrixStaysSparse) {
  const std::string text =
      "[parameters]\nm = 1000\n[dynamics]\nA = \"tridiag(m, m^2, -2*m^2, m^2)\"\nB = \"zero(m, 1)\"\n"
      "x0 = \"sin(pi*(i + 1)/(m + 1))\"\n[complementarity]\nN = \"zero(1, m)\"\nM = [[1]]\n[time]\nT = 1\n";
  const Scene scene = parse_sections(text).scene;
  const auto* sparse = get_if<SparseDynamics>(&scene.dynamics);
  ASSERT_NE(sparse, nullptr);
  EXPECT_EQ(sparse->A.nonZeros(), 2998);
  EXPECT_EQ(sparse->A.coeff(999, 998), 1e6);
  ASSERT_EQ(scene.x0.size(), 1000);
  EXPECT_DOUBLE_EQ(scene.x0[499], std::sin(std::acos(-1.0) * 500 / 1001));
}

TEST(SceneSections, OneExpressionForAllEntries) {
  const SceneFile file =
      parse_sections(with_replaced(with_replaced(two_states, "x0 = [1, 0]", "x0 = \"1 - i\"\nf = \"(i + 1)*t\""),
                                   "M = [[1]]", "M = [[1]]\ng = \"t - i\""));
  EXPECT_EQ(file.scene.x0, (Vector{{1, 0}}));
  Vector f(2), g(1);
  file.scene.f(0.5, f);
  file.scene.g(0.5, g);
  EXPECT_EQ(f, (Vector{{0.5, 1}}));
  EXPECT_EQ(g, (Vector{{0.5}}));
  const SceneFile own =
      parse_sections("[parameters]\ni = 7\n" + with_replaced(two_states, "x0 = [1, 0]", "x0 = \"i\""));
  EXPECT_EQ(own.scene.x0, (Vector{{7, 7}})) << "a parameter i has priority";
  expect_refused_sections(
      {{with_replaced(two_states, "x0 = [1, 0]", "x0 = \"k\""), "my.toml:4: dynamics.x0: 'k' uses 'k'"}});
}

TEST(SceneSections, DefinitionsAreUsableInSources) {
  const std::string text = "[parameters]\nT1 = 0.25\n[definitions]\nu = \"pulse(t, T1, T1/2)\"\nv = \"2*u\"\n" +
                           with_replaced(two_states, "x0 =", "f = [\"v + t\", \"u\"]\nx0 =");
  const Scene scene = parse_sections(text).scene;
  Vector f(2);
  for (const double t : {0.0, 0.1, 0.125, 0.2, 0.25, 0.3}) {
    scene.f(t, f);
    const double u = t - 0.25 * std::floor(t / 0.25) < 0.125 ? 1 : 0;
    EXPECT_NEAR(f[0], 2 * u + t, 1e-15) << t;
    EXPECT_EQ(f[1], u) << t;
  }
  EXPECT_EQ(scene.breakpoints, (std::vector{0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0}));
  EXPECT_TRUE(scene.breakpoints_are_all);
  expect_refused_sections({
      {"[definitions]\nv = \"2*u\"\nu = \"t\"\n" + two_states,
       "my.toml:2: definitions.v: '2*u' uses 'u', which is not defined"},
      {"[definitions]\nt = \"1\"\n" + two_states, "my.toml:2: definitions.t: 't' already has a meaning"},
      {"[parameters]\nR = 1\n[definitions]\nR = \"t\"\n" + two_states,
       "my.toml:4: definitions.R: 'R' is defined twice"},
      {"[definitions]\nu = \"t\"\n" + with_replaced(two_states, "[[1]]", "[[\"u\"]]"),
       "my.toml:9: complementarity.M: 'u' depends on the time t; only f, g"},
      {"[definitions]\nu = [1]\n" + two_states, "my.toml:2: definitions.u: found a list; give a finite number"},
  });
}

TEST(SceneSections, TimeMayStateATolerance) {
  const auto tolerance = [](const std::string& lines) {
    return default_tolerance(parse_sections(two_states + lines).scene);
  };
  EXPECT_EQ(tolerance(""), 1e-3);  // neither steps nor a tolerance
  EXPECT_EQ(tolerance("steps = 7\n"), 0);
  EXPECT_EQ(tolerance("steps = 7\ntol = 1e-5\n"), 1e-5);
  EXPECT_EQ(tolerance("tolerance = \"1/1000\"\n"), 1e-3);
  expect_refused_sections(
      {{two_states + "tolerance = 2\n", "my.toml:10: time.tolerance: found 2; give a number between 0 and 1"},
       {two_states + "tol = 1e-3\ntolerance = 1e-3\n", "my.toml:11: time.tolerance: is given beside tol"},
       {two_states + "tolerance = 0\n", "my.toml:10: time.tolerance: found 0; give"}});
}

TEST(SceneSections, SettingsReplaceTAndSteps) {
  const SceneFile file = parse_sections(two_states, {{"T", 3}, {"steps", 1e3}});
  EXPECT_EQ(file.scene.T, 3);
  EXPECT_EQ(file.scene.default_steps, 1000);
  const SceneFile parameter =
      parse_sections("[parameters]\nT = 2\n" + with_replaced(two_states, "T = 1", "T = \"2*T\""), {{"T", 3}});
  EXPECT_EQ(parameter.scene.T, 6) << "a parameter T has priority";
}

TEST(SceneSections, RelaysTakeAnOffset) {
  const std::string relay =
      "[dynamics]\nA = [[0]]\nB = [[1]]\nx0 = [0]\n[relay]\nC = [[1]]\ne = [\"-t\"]\n[time]\nT = 1\n";
  const Scene scene = parse_sections(relay).scene;
  EXPECT_EQ(scene.relays, 1);
  Vector g(2);
  scene.g(0.25, g);
  EXPECT_EQ(g, (Vector{{0.25, 1}})) << "(-e, 1)";
  // x' in -Sgn(x - t/2), x(0) = 0: x follows t/2, with lambda = 1/2, s = 1/4.
  const Scene follows = parse_sections(with_replaced(relay, "\"-t\"", "\"-t/2\"")).scene;
  Options options = options_for(Method::march, 64);
  options.states = StateSelection::all;
  const Result result = run(follows, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  for (Index j = 1; j <= 64; ++j) {
    EXPECT_NEAR(result.x(j, 0), result.t[j] / 2, 1e-12);
    EXPECT_NEAR(result.y(j, 0), 0.25, 1e-11);
  }
  const Scene heavy = parse_sections(with_replaced(relay, "x0 = [0]", "x0 = [0]\nE = [[2]]")).scene;
  EXPECT_EQ(get<DenseDynamics>(heavy.dynamics).E, (Matrix{{2}}));
  expect_refused_sections(
      {{with_replaced(relay, "[\"-t\"]", "[1, 2]"), "my.toml:7: relay.e: has 2 entries; give 1, one per row of C"},
       {with_replaced(relay, "[\"-t\"]", "[\"log(t)\"]"), "my.toml:7: relay.e: entry (0) is inf"}});
}

TEST(SceneSections, NamesAndUnits) {
  const std::string labels =
      "[names]\nx = [\"v\", \"i\"]\nw = [\"slack\"]\n[units]\nt = \"s\"\nx = [\"V\", \"A\"]\ny = \"A\"\n";
  const Scene scene = parse_sections(two_states + labels + "[output]\nstates = \"i\"\n").scene;
  EXPECT_EQ(state_name(scene, 1), "i");
  EXPECT_EQ(multiplier_name(scene, 0), "y0");
  EXPECT_EQ(slack_name(scene, 0), "slack");
  EXPECT_EQ(find_state(scene, "v"), 0);
  EXPECT_EQ(find_state(scene, "x1"), 1);
  EXPECT_EQ(find_state(scene, "w"), -1);
  EXPECT_EQ(scene.units.x, (std::vector<std::string>{"V", "A"}));
  EXPECT_EQ(scene.units.y, (std::vector<std::string>{"A"}));
  EXPECT_EQ(scene.time_unit, "s");
  const auto names = [](const std::string& line) { return two_states + "[names]\n" + line + "\n"; };
  expect_refused_sections({
      {names("x = [\"v\"]"), "my.toml:11: names.x: has 1 entries; give 2"},
      {names("x = [\"v\", \"v\"]"), "my.toml:11: names.x: 'v' is taken; give every component a name of its own"},
      {names("x = [\"v\", \"i\"]\ny = [\"i\"]"), "my.toml:12: names.y: 'i' is taken"},
      {names("x = [\"t\", \"i\"]"), "my.toml:11: names.x: 't' is taken"},
      {names("x = [\"a,b\", \"i\"]"), "my.toml:11: names.x: found 'a,b'; give names without commas"},
      {names("x = [\"\", \"i\"]"), "my.toml:11: names.x: found ''; give names"},
      {names("x = [\"y0\", \"i\"]"), "my.toml:11: names.x: 'y0' is taken; give every component a name of its own"},
      {names("x = [1, 2]"), "my.toml:11: names.x: found 1; give a list of 2 texts in quotes"},
      {names("z = [\"a\"]"), "my.toml:11: names.z: is no known key"},
      {two_states + "[units]\nx = [\"V\"]\n", "my.toml:11: units.x: has 1 entries; give 2"},
      {two_states + labels + "[output]\nstates = \"j\"\n", "my.toml:18: output.states: found 'j'"},
  });
}

TEST(SceneSections, StatesMayBeCountedFromOne) {
  const Scene scene = parse_sections(two_states + "[names]\nx = [\"x1\", \"x2\"]\n").scene;
  EXPECT_EQ(find_state(scene, "x1"), 0) << "the name of the file";
  EXPECT_EQ(find_state(scene, "x2"), 1);
}

TEST(SceneSections, ANumberIsThatMultipleOfTheIdentity) {
  const std::string three =
      "[parameters]\nR = 2\n[dynamics]\nA = \"zero(2)\"\nE = 3\nB = [[1, 0, 0], [0, 1, 0]]\n[complementarity]\n"
      "N = [[1, 0], [0, 1], [1, 1]]\nM = 1.5\n[boundary]\nE0 = 1\nET = -1\nb = [0, 0]\n[time]\nT = 1\n";
  const SceneFile file = parse_sections(three);
  EXPECT_EQ(to_dense(file.scene.M), (Matrix{{1.5, 0, 0}, {0, 1.5, 0}, {0, 0, 1.5}}));
  EXPECT_EQ(dense_matrices(file).E, (Matrix{{3, 0}, {0, 3}}));
  EXPECT_EQ(file.scene.boundary->ET, (Matrix{{-1, 0}, {0, -1}}));
  EXPECT_EQ(to_dense(parse_sections(with_replaced(three, "1.5", "\"R/4\"")).scene.M)(2, 2), 0.5);
  EXPECT_EQ(to_dense(parse_sections(with_replaced(three, "1.5", "0.0")).scene.M), (Matrix::Zero(3, 3)));
  expect_refused_sections({{with_replaced(three, "1.5", "\"S\""), "my.toml:9: complementarity.M: found the text 'S'"},
                           {with_replaced(three, "\"zero(2)\"", "1"), "my.toml:4: dynamics.A: found 1; give rows"}});
}

// x' = -x, x(0) = 3.
TEST(SceneSections, NoConstraints) {
  const Scene scene = parse_sections("[dynamics]\nA = [[-1]]\nx0 = [3]\n[time]\nT = 1\nsteps = 4\n").scene;
  EXPECT_EQ(scene.constraints(), 0);
  Options options;
  options.states = StateSelection::all;
  const Result r = solve(scene, *make_cpu_backend(1), options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NEAR(r.x(4, 0), 3 * std::exp(-1.0), 1e-12);  // one exponential a step, to rounding
  expect_refused_sections(
      {{"[dynamics]\nA = [[-1]]\nB = [[1]]\nx0 = [3]\n[time]\nT = 1\n", "my.toml:1: complementarity.N: is missing"},
       {"[dynamics]\nA = [[-1]]\nx0 = [3]\n[complementarity]\nN = [[1]]\nM = [[1]]\n[time]\nT = 1\n",
        "my.toml:1: dynamics.B: is missing"}});
}

// x1' in -(1 + t) Sgn(x1), x1(0) = 1, is 0 from t + t^2/2 = 1 on. Beside it x2' = -1 + y, 0 <= y perp x2 >= 0, x2(0) =
// 1/2, rests from t = 1/2 on.
TEST(SceneSections, RelaysWithBoundsBesidePairs) {
  const std::string text =
      "[dynamics]\nA = \"zero(2)\"\nB = [[1, 0], [0, 1]]\nf = [0, -1]\nx0 = [1, 0.5]\n[relay]\nC = [[1, 0]]\n"
      "bound = [\"1 + t\"]\n[complementarity]\nN = [[0, 1]]\nM = 0\ng = [\"0*t\"]\n[time]\nT = 1\nsteps = 100\n";
  const Scene scene = parse_sections(text).scene;
  EXPECT_EQ(scene.constraints(), 3);
  Options options;
  options.states = StateSelection::all;
  options.method = Method::events;
  options.tolerance = 1e-6;
  const Result r = solve(scene, *make_cpu_backend(1), options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  const double hit = std::sqrt(3.0) - 1;
  for (Index j = 0; j < r.t.size(); ++j) {
    const double t = r.t[j];
    EXPECT_NEAR(r.x(j, 0), std::max(0.0, 1 - t - t * t / 2), 1e-6) << t;
    EXPECT_NEAR(r.x(j, 1), std::max(0.0, 0.5 - t), 1e-6) << t;
    if (std::abs(t - hit) < 0.01 || std::abs(t - 0.5) < 0.01) continue;
    EXPECT_NEAR(r.y(j, 0), t < hit ? 1 + t : (1 + t) / 2, 1e-5) << "lambda = b - 2 y, -b and then 0, t = " << t;
    EXPECT_NEAR(r.y(j, 2), t < 0.5 ? 0 : 1, 1e-5) << t;
  }
  expect_refused_sections(
      {{with_replaced(text, "[\"1 + t\"]", "[1, 1]"),
        "my.toml:8: relay.bound: has 2 entries; give 1, one per row of C"},
       {with_replaced(text, "[[0, 1]]\nM", "[[0, 1], [1, 0]]\nM"), "my.toml:3: dynamics.B: has 1 columns for y"}});
}

}  // namespace
}  // namespace bromwich
