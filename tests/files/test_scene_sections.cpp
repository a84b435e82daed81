// Sections and values of scene files that stand for longer ones: included files, definitions, matrices and vectors by a
// word, rectangles, offsets of relays, names and units. Each is compared with the scene written out.

#include "core/base/error.hpp"
#include "core/catalogue/catalogue.hpp"
#include "core/scene/component_names.hpp"
#include "files/scene_file.hpp"
#include "files/scene_file_keys.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

namespace bromwich {
namespace {

namespace fs = std::filesystem;

const std::string two_states =
    "[dynamics]\nA = [[-2, 1], [1, -2]]\nB = [[1], [0]]\nx0 = [1, 0]\n[complementarity]\nN = [[1, 0]]\nM = [[1]]\n"
    "[time]\nT = 1\n";

std::string with_replaced(std::string text, const std::string& from, const std::string& to) {
  text.replace(text.find(from), from.size(), to);
  return text;
}

SceneFile parse_sections(const std::string& text, const ParameterValues& settings = {}) {
  return parse_scene(text, "my.toml", {}, settings);
}

std::string refused_section(const std::string& text) {
  return refusal([&] { parse_sections(text); });
}

void expect_refused_sections(const std::vector<Refused>& cases) {
  for (const Refused& bad : cases) {
    const std::string found = refused_section(bad.text);
    EXPECT_TRUE(found.starts_with(bad.message)) << found << "\nexpected: " << bad.message;
    EXPECT_NE(found.find("; "), std::string::npos) << found;  // what to do
  }
}

const DenseDynamics& dense_matrices(const SceneFile& file) { return get<DenseDynamics>(file.scene.dynamics); }

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
  EXPECT_FALSE(parse_sections(two_states).tolerance);
  EXPECT_EQ(parse_sections(two_states + "tolerance = \"1/1000\"\n").tolerance, 1e-3);
  expect_refused_sections(
      {{two_states + "tolerance = 2\n", "my.toml:10: time.tolerance: found 2; give a number between 0 and 1"},
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

TEST(SceneSections, ARectangleIsTheBuiltInOne) {
  const std::string text = R"toml(
[parameters]
Q = 7
dx = "1/(Q + 1)"
c = 2e-3
[kronecker]
points = "Q"
spacing = "dx"
diffusivity = "c"
b = ["c/dx^2"]
n = [-2]
[definitions]
wide = "4/(1 + t)"
narrow = "sin(2*pi*t)"
[dynamics]
f = "abs(4*(i + 1) - 2*(Q + 1)) >= Q + 1 ? wide : narrow"
x0 = "2*(i + 1)*dx*(1 - (i + 1)*dx)*(j + 1)*dx*(1 - (j + 1)*dx)"
[complementarity]
M = "tridiag(Q, -1, 4, -1)"
g = [
  "3*wide", "4*wide - wide - narrow", "4*narrow - wide - narrow", "2*narrow", "4*narrow - wide - narrow",
  "4*wide - wide - narrow", "3*wide",
]
class = "P"
[time]
T = 4
steps = 100
)toml";
  Scene scene = parse_sections(text).scene;
  const Scene known = make_scene("signorini", {{"Q", 7}});
  ASSERT_TRUE(holds<KroneckerDynamics>(scene.dynamics));
  EXPECT_TRUE(std::holds_alternative<Tridiagonal>(scene.M));
  EXPECT_LE((scene.x0 - known.x0).cwiseAbs().maxCoeff(), 1e-16);
  // |x2 - 1/2| >= 1/4 holds for lines 0, 1 and 5, 6 of 7: g = M psi with psi = (w, w, s, s, s, w, w).
  scene.breakpoints.clear();  // switches of the condition on i, which does not change; the built-in one names none
  EXPECT_LT(distance(solved_y(scene, Method::march, 100), solved_y(known, Method::march, 100)), same_problem);
  EXPECT_LT(distance(solved_y(scene, Method::contour, 100), solved_y(known, Method::contour, 100)), same_problem);
}

TEST(SceneSections, RectanglesOfTwoDifferentSides) {
  const std::string text =
      "[kronecker]\npoints = [3, 2]\nspacing = [1, 0.5]\ndiffusivity = [2, 3]\nb = [1]\nn = [0, 5]\n"
      "[dynamics]\nx0 = \"10*i + j\"\n[complementarity]\nM = \"identity\"\n[time]\nT = 1\n";
  const Scene scene = parse_sections(text).scene;
  const DenseDynamics d = to_dense(scene.dynamics);
  EXPECT_EQ(d.A(0, 0), -2 * (2 + 12));
  EXPECT_EQ(d.A(0, 1), 12) << "across";
  EXPECT_EQ(d.A(0, 2), 2) << "along";
  EXPECT_EQ(d.N.row(1), (Eigen::RowVectorXd{{0, 0, 0, 5, 0, 0}}));
  EXPECT_EQ(scene.x0, (Vector{{0, 1, 10, 11, 20, 21}}));
  const auto with_line = [&](const std::string& from, const std::string& to) { return with_replaced(text, from, to); };
  expect_refused_sections({
      {with_line("points = [3, 2]", "points = [3, 2, 1]"),
       "my.toml:2: kronecker.points: has 3 entries; give one number or two"},
      {with_line("points = [3, 2]", "points = 0"), "my.toml:2: kronecker.points: found 0; give whole numbers from 1"},
      {with_line("spacing = [1, 0.5]", "spacing = -1"),
       "my.toml:3: kronecker.spacing: found -1; give positive numbers"},
      {with_line("n = [0, 5]", "n = [0, 5, 6]"), "my.toml:6: kronecker.n: has 3 entries; give at most 2"},
      {with_line("b = [1]\n", ""), "my.toml:1: kronecker.b: is missing; add b = ... to [kronecker]"},
      {with_line("x0 =", "A = [[1]]\nx0 ="),
       "my.toml:8: dynamics.A: is given with a section [kronecker]; leave it out"},
      {with_line("M =", "N = [[1]]\nM ="), "my.toml:10: complementarity.N: is given with a section [kronecker]"},
      {with_line("x0 =", "f = [1]\nx0 ="), "my.toml:8: dynamics.f: has 1 entries; give 3, one per line"},
  });
}

TEST(SceneSections, BoxesAreTheBuiltInOne) {
  const std::string text = R"toml(
[parameters]
Q = 5
dx = "1/(Q + 1)"
c = 2e-3
[kronecker]
dimensions = 3
points = "Q"
spacing = "dx"
diffusivity = "c"
b = ["c/dx^2"]
n = [-2]
[dynamics]
x0 = "0.01*i - 0.02*j"
[complementarity]
M = "stencil(Q, Q, 6, -1, -1)"
g = "sin(3*t + i)"
class = "P"
[time]
T = 1
steps = 20
)toml";
  const Scene scene = parse_sections(text).scene, known = make_scene("signorini3d", {{"Q", 5}});
  const auto& found = get<KroneckerDynamics>(scene.dynamics);
  const auto& expected = get<KroneckerDynamics>(known.dynamics);
  ASSERT_EQ(found.beside.size(), 1u);
  const SparseDynamics a = to_sparse(found), b = to_sparse(expected);
  EXPECT_EQ((a.A - b.A).norm(), 0);
  EXPECT_EQ((a.B - b.B).norm(), 0);
  EXPECT_EQ((a.N - b.N).norm(), 0);
  ASSERT_TRUE(sparse_of(scene.M) && sparse_of(known.M));
  EXPECT_EQ(scene.x0[7], 0.01 * 1 - 0.02 * 2);
  Scene same = known;
  same.f = {}, same.g = scene.g, same.x0 = scene.x0, same.T = 1, same.M = scene.M;
  EXPECT_LT(distance(solved_y(scene, Method::march, 20), solved_y(same, Method::march, 20)), same_problem);
  const auto with_line = [&](const std::string& from, const std::string& to) { return with_replaced(text, from, to); };
  expect_refused_sections({
      {with_line("points = \"Q\"", "points = [5, 5]"),
       "my.toml:8: kronecker.points: has 2 entries; give one number or 3"},
      {with_line("dimensions = 3", "dimensions = 4"),
       "my.toml:7: kronecker.dimensions: found 4; give 1 (a line), 2 (a"},
      {with_line("dimensions = 3", "beside = \"neumann\""),
       "my.toml:7: kronecker.beside: is given with dimensions = 2"},
      {with_line("spacing = \"dx\"", "spacing = [0.1, 0, 0.1]"),
       "my.toml:9: kronecker.spacing: found 0; give positive"},
      {with_line("stencil(Q, Q, 6, -1, -1)", "stencil(Q, 6, -1)"),
       "my.toml:16: complementarity.M: stencil has 3 arguments; write stencil(points, points, centre"},
  });
}

TEST(SceneSections, BoxesWithEndsOfTheirOwnAreWrittenOut) {
  const std::string text =
      "[kronecker]\ndimensions = 3\npoints = [3, 2, 4]\nlength = [1, 1, 2]\ndiffusivity = 0.1\nadvection = [0, 0.2, "
      "0]\n"
      "beside = \"neumann\"\nacross = [1, \"dirichlet\"]\nb = [2]\nn = [-1]\n"
      "[dynamics]\nx0 = \"0\"\n[complementarity]\nM = \"identity\"\ng = \"t - 0.5\"\n[time]\nT = 1\n";
  const Scene scene = parse_sections(text).scene;
  const Matrix A = to_dense(scene.dynamics).A;
  // A constant along `beside` flows across alone: mirrored at its ends, and advection does not change it.
  const double along = 0.1 * 16, across = 0.1 / std::pow(2 / 4.5, 2);
  EXPECT_NEAR(A(4 * 2 + 1, 4 * 2 + 1) + A(4 * 2 + 1, 4 * 3 + 1), -2 * along - 2 * across, 1e-14);
  EXPECT_NEAR(A(4 * 2 + 1, 1), along, 1e-14) << "the next point along";
  EXPECT_EQ(scene.constraints(), 6);
}

// c u'' - v u' with u = `first` u_1 and `last` u_points beyond the ends.
Matrix by_ghost_values(Index points, double dx, double c, double v, double first, double last) {
  Matrix D = Matrix::Zero(points, points);
  for (Index i = 0; i < points; ++i) {
    const auto add = [&](Index j, double weight) {
      D(i, std::clamp<Index>(j, 0, points - 1)) += j < 0 ? first * weight : j == points ? last * weight : weight;
    };
    add(i - 1, c / (dx * dx) + v / (2 * dx));
    add(i, -2 * c / (dx * dx));
    add(i + 1, c / (dx * dx) - v / (2 * dx));
  }
  return D;
}

const std::string plate =
    "[kronecker]\npoints = [4, 3]\nlength = [2, 1]\ndiffusivity = [0.2, 0.1]\nadvection = [0.5, -0.3]\n"
    "reaction = 0.7\nalong = [\"neumann\", 3]\nacross = [\"dirichlet\", \"1/2\"]\nb = [2, 0.5]\nn = [-1]\n"
    "far_b = [3]\nfar_n = [-1, 0.25]\n"
    "[dynamics]\nx0 = \"0.1*i - 0.2*j\"\nf = \"0.3*cos(t)*(i - 4)\"\n"
    "[complementarity]\nM = \"tridiag(4, -1, 3, -1)\"\ng = \"0.8*sin(3*t + i)\"\n[time]\nT = 2\n";

// The scene of `plate` from matrices that are put together here.
Scene plate_in_matrices() {
  const double dx = 2 / 4.0, dy = 1 / 3.5;  // half a cell less at each Neumann or Robin end
  const auto mirrored = [](double a, double h) { return (1 - a * h / 2) / (1 + a * h / 2); };
  const Matrix along = by_ghost_values(4, dx, 0.2, 0.5, 1, mirrored(3, dx));
  const Matrix across = by_ghost_values(3, dy, 0.1, -0.3, 0, mirrored(0.5, dy));
  DenseDynamics d{-0.7 * Matrix::Identity(12, 12), Matrix::Zero(12, 8), Matrix::Zero(8, 12)};
  Matrix M = Matrix::Zero(8, 8);
  for (Index l = 0; l < 4; ++l) {
    for (Index k = 0; k < 4; ++k) d.A.block(3 * l, 3 * k, 3, 3) += along(l, k) * Matrix::Identity(3, 3);
    d.A.block(3 * l, 3 * l, 3, 3) += across;
    d.B.block(3 * l, l, 3, 1) = Vector{{2, 0.5, 0}};
    d.B.block(3 * l, 4 + l, 3, 1) = Vector{{0, 0, 3}};
    d.N.block(l, 3 * l, 1, 3) = Eigen::RowVector3d(-1, 0, 0);
    d.N.block(4 + l, 3 * l, 1, 3) = Eigen::RowVector3d(0, 0.25, -1);
    for (const Index side : {0, 4})
      for (Index k = 0; k < 4; ++k) M(side + l, side + k) = l == k ? 3 : std::abs(l - k) == 1 ? -1 : 0;
  }
  Scene scene;
  const Matrix B = d.B;
  scene.x0 = Vector::NullaryExpr(12, [](Index s) { return 0.1 * double(s / 3) - 0.2 * double(s % 3); });
  scene.f = [B](double t, Eigen::Ref<Vector> f) {
    f = B * Vector::NullaryExpr(8, [&](Index i) { return 0.3 * std::cos(t) * double(i - 4); });
  };
  scene.g = [](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < 8; ++i) g[i] = 0.8 * std::sin(3 * t + double(i));
  };
  scene.dynamics = std::move(d);
  scene.M = M;
  scene.T = 2;
  return scene;
}

TEST(SceneSections, RectanglesHaveEndsOfTheirOwn) {
  const Scene scene = parse_sections(plate).scene, known = plate_in_matrices();
  const DenseDynamics d = to_dense(scene.dynamics), e = to_dense(known.dynamics);
  EXPECT_LE((d.A - e.A).cwiseAbs().maxCoeff(), 1e-14 * e.A.cwiseAbs().maxCoeff());
  EXPECT_EQ(d.B, e.B);
  EXPECT_EQ(d.N, e.N);
  EXPECT_TRUE(std::holds_alternative<Tridiagonal>(scene.M)) << "blocks of both sides";
  for (const Method method : {Method::march, Method::contour, Method::multigrid, Method::euler, Method::automatic}) {
    const RowMatrix y = solved_y(scene, method, 128);
    EXPECT_GT((y.array() > 0).count(), 200) << "contact is made, and lost";
    EXPECT_GT((y.array() == 0).count(), 200);
    EXPECT_LT(distance(y, solved_y(known, method, 128)), 1e-10) << to_string(method);
  }
}

TEST(SceneSections, LinesAndSourcesOfRectangles) {
  const std::string line =
      "[kronecker]\ndimensions = 1\npoints = 5\nspacing = 0.5\ndiffusivity = 2\nadvection = 1\n"
      "across = \"neumann\"\nb = [1]\nn = [1]\n[dynamics]\nx0 = \"j\"\nF = \"identity(5)\"\nf = \"i\"\n"
      "[complementarity]\nM = [[1]]\n[time]\nT = 1\n";
  const Scene scene = parse_sections(line).scene;
  EXPECT_EQ(to_dense(scene.dynamics).A, by_ghost_values(5, 0.5, 2, 1, 1, 1));
  EXPECT_EQ(scene.constraints(), 1);
  EXPECT_EQ(scene.x0, (Vector{{0, 1, 2, 3, 4}}));
  EXPECT_EQ(scene.f_entry, SourceEntry::through_F);
  const auto with = [&](const std::string& from, const std::string& to) { return with_replaced(plate, from, to); };
  expect_refused_sections({
      {with("\"neumann\", 3", "\"neuman\", 3"), "my.toml:7: kronecker.along: found the text 'neuman' (did you mean"},
      {with("\"neumann\", 3", "3"), "my.toml:7: kronecker.along: has 1 entries; give one for both ends, or two"},
      {with("\"neumann\", 3", "\"neumann\", -3"), "my.toml:7: kronecker.along: is -3; give a Robin coefficient"},
      {with("[0.5, -0.3]", "[0.5, -3]"), "my.toml:5: kronecker.advection: is -3, and central differences oscillate"},
      {with("reaction", "spacing = 1\nreaction"), "my.toml:3: kronecker.length: is given with spacing"},
      {with("far_b = [3]\n", ""), "my.toml:1: kronecker.far_b: is missing"},
      {with("points", "dimensions = 4\npoints"), "my.toml:2: kronecker.dimensions: found 4; give 1"},
      {with("points", "dimensions = 1\npoints"), "my.toml:8: kronecker.along: is given with dimensions = 1"},
      {with("tridiag(4", "tridiag(3"), "my.toml:17: complementarity.M: is 3 x 3; make it 4 x 4 for each"},
  });
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
      {names("x = [\"x1\", \"x0\"]"), "my.toml:11: names.x: found 'x1' for component 0; choose another name"},
      {names("x = [1, 2]"), "my.toml:11: names.x: found 1; give a list of 2 texts in quotes"},
      {names("z = [\"a\"]"), "my.toml:11: names.z: is no known key"},
      {two_states + "[units]\nx = [\"V\"]\n", "my.toml:11: units.x: has 1 entries; give 2"},
      {two_states + labels + "[output]\nstates = \"j\"\n", "my.toml:18: output.states: found 'j'"},
  });
}

/// Files of a test in a folder of their own.
class Included : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("bromwich_include_" + std::to_string(::getpid()));
    fs::create_directories(folder_ / "sub");
  }
  void TearDown() override { fs::remove_all(folder_); }
  void save(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
  }
  SceneFile read(const std::string& name, const ParameterValues& settings = {}) const {
    return read_scene_file(folder_ / name, settings);
  }
  std::string refused_section(const std::string& name) const {
    std::string found = refusal([&] { read(name); });
    for (std::size_t at; (at = found.find(folder_.string() + "/")) != std::string::npos;)
      found.erase(at, folder_.string().size() + 1);
    return found;
  }

  fs::path folder_;
};

TEST_F(Included, KeysOfTheFileReplaceThoseOfIncludedOnes) {
  save("sub/common.toml",
       "[parameters]\nR = 2\nC = \"2*R\"\n[dynamics]\nA = \"A.csv\"\nB = [[1]]\nx0 = [\"C\"]\n[time]\nT = 5\n");
  save("sub/A.csv", "-3\n");
  save("later.toml", "[time]\nT = 7\nsteps = 9\n");
  save("main.toml",
       "include = [\"sub/common.toml\", \"later.toml\"]\n[parameters]\nR = 10\n[complementarity]\nN = [[1]]\nM = "
       "[[\"R\"]]\n");
  const SceneFile file = read("main.toml");
  EXPECT_EQ(get<DenseDynamics>(file.scene.dynamics).A, Matrix{{-3}}) << "relative to the included file";
  EXPECT_EQ(file.scene.x0, Vector{{20}}) << "C follows the replaced R";
  EXPECT_EQ(file.scene.T, 7);
  EXPECT_EQ(file.scene.default_steps, 9);
  EXPECT_EQ(file.scene.name, "main");
  EXPECT_EQ(read("main.toml", {{"R", 1}}).scene.x0, Vector{{2}});
  std::set<std::string> inputs;
  for (const fs::path& input : file.inputs) inputs.insert(input.filename());
  EXPECT_EQ(inputs, (std::set<std::string>{"A.csv", "common.toml", "later.toml", "main.toml"}));
}

TEST_F(Included, MistakesNameTheFileThatHasThem) {
  save("common.toml", "[parameters]\nR = 2\n\n[dynamics]\nA = [[1, 2]]\n");
  save("main.toml", "include = \"common.toml\"\n" + with_replaced(two_states, "A = [[-2, 1], [1, -2]]\n", ""));
  EXPECT_TRUE(refused_section("main.toml").starts_with("common.toml:5: dynamics.A: is 1 x 2; make it square"))
      << refused_section("main.toml");
  save("key.toml", "[dynamics]\nQ = 1\n");
  save("main.toml", "include = [\"key.toml\"]\n" + two_states);
  EXPECT_TRUE(refused_section("main.toml").starts_with("key.toml:2: dynamics.Q: is no known key"))
      << refused_section("main.toml");
  save("broken.toml", "\n[dynamics\n");
  save("main.toml", "include = [\"broken.toml\"]\n" + two_states);
  EXPECT_TRUE(refused_section("main.toml").starts_with("broken.toml:2: ")) << refused_section("main.toml");
  save("main.toml", "include = [\"none.toml\"]\n" + two_states);
  EXPECT_TRUE(refused_section("main.toml")
                  .starts_with("main.toml:1: include: the file 'none.toml' does not exist; name a file"))
      << refused_section("main.toml");
  save("main.toml", "include = 3\n" + two_states);
  EXPECT_EQ(refused_section("main.toml"),
            "main.toml:1: include: found 3; give a list of files such as [\"common.toml\"]");
}

TEST_F(Included, CyclesAreRefused) {
  save("a.toml", "include = [\"b.toml\"]\n" + two_states);
  save("b.toml", "\ninclude = [\"sub/../a.toml\"]\n");
  EXPECT_EQ(refused_section("a.toml"),
            "b.toml:2: include: 'sub/../a.toml' includes itself, directly or through other files; remove one of these "
            "includes");
  save("c.toml", "include = [\"c.toml\"]\n");
  EXPECT_TRUE(refused_section("c.toml").starts_with("c.toml:1: include: 'c.toml' includes itself"))
      << refused_section("c.toml");
  save("twice.toml", "include = [\"d.toml\", \"e.toml\"]\n" + two_states);
  save("d.toml", "include = [\"e.toml\"]\n");
  save("e.toml", "[parameters]\nR = 1\n");
  EXPECT_EQ(read("twice.toml").parameters.at("R"), 1) << "twice, but no cycle";
}

TEST_F(Included, ByteOrderMarksAndLineEndsOfWindowsAreAccepted) {
  const auto windows = [](std::string text) {
    for (std::size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 2) text.replace(at, 1, "\r\n");
    return "\xEF\xBB\xBF" + text;
  };
  const std::string text = with_replaced(with_replaced(two_states, "[[-2, 1], [1, -2]]", "\"A.mtx\""), "x0 = [1, 0]",
                                         "x0 = \"x0.csv\"\nf = \"f.csv\"");
  save("scene.toml", windows(text));
  save("A.mtx", windows("%%MatrixMarket matrix coordinate real general\n2 2 4\n1 1 -2\n1 2 1\n2 1 1\n2 2 -2\n"));
  save("x0.csv", windows("1, 0\n"));
  save("f.csv", windows("t,f0,f1\n0,0,1\n1,2,3\n"));
  const SceneFile file = read("scene.toml");
  EXPECT_EQ(get<DenseDynamics>(file.scene.dynamics).A, (Matrix{{-2, 1}, {1, -2}}));
  EXPECT_EQ(file.scene.x0, (Vector{{1, 0}}));
  Vector f(2);
  file.scene.f(0.5, f);
  EXPECT_EQ(f, (Vector{{1, 2}}));
  save("wide.toml", std::string("\xFF\xFE[\0", 4));
  EXPECT_TRUE(refused_section("wide.toml").ends_with("the file 'wide.toml' is in UTF-16; save it as UTF-8"))
      << refused_section("wide.toml");
}

// The published schema has the keys of the reader, and no others.
TEST(SceneSchema, HasTheKeysOfTheReader) {
  std::ifstream file(fs::path(BROMWICH_EXAMPLES).parent_path() / "docs" / "scene.schema.json");
  const nlohmann::json schema = nlohmann::json::parse(file), &sections = schema.at("properties");
  const auto keys_of = [](const nlohmann::json& object) {
    std::set<std::string> keys;
    for (const auto& [key, value] : object.items()) keys.insert(key);
    return keys;
  };
  for (const SectionKeys& section : scene_file_keys()) {
    const std::set<std::string> keys(section.keys.begin(), section.keys.end());
    if (section.name.empty()) {
      EXPECT_EQ(keys_of(sections), keys);
      EXPECT_EQ(schema.at("additionalProperties"), false);
    } else if (keys.empty()) {  // any key, with values of one kind
      EXPECT_TRUE(sections.at(section.name).at("additionalProperties").is_object()) << section.name;
    } else {
      EXPECT_EQ(keys_of(sections.at(section.name).at("properties")), keys) << section.name;
      EXPECT_EQ(sections.at(section.name).at("additionalProperties"), false) << section.name;
    }
  }
}

}  // namespace
}  // namespace bromwich
