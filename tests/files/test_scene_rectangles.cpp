// Lines, rectangles and boxes in scene files, compared with the built-in scenes and with matrices written out.

#include "catalogue/catalogue.hpp"
#include "tests/files/scene_texts.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

namespace bromwich {
namespace {

TEST(SceneRectangles, ARectangleIsTheBuiltInOne) {
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

// Above 512 states; tests/dynamics/test_rectangle.cpp and tests/solve/test_symmetric_form.cpp take all combinations.
TEST(SceneRectangles, EndsAndAdvectionAreSolvedInModes) {
  const auto text = [](const char* advection) {
    return std::string("[kronecker]\npoints = [24, 25]\nlength = [1, 2]\ndiffusivity = 0.05\nreaction = 0.2\n") +
           advection +
           "along = [\"neumann\", 1.5]\nacross = [\"neumann\", \"dirichlet\"]\nb = [20]\nn = [1]\n"
           "[dynamics]\nx0 = \"0.01*i\"\nf = \"0.1*cos(t)\"\n"
           "[complementarity]\nM = \"identity\"\ng = \"0.3*sin(4*t) - 0.1\"\n[time]\nT = 1\nsteps = 64\n";
  };
  Rectangle r;
  const double dx = GridLine::spacing_of(24, 1, neumann, 1.5), dy = GridLine::spacing_of(25, 2, neumann, dirichlet);
  r.along = {24, dx, 0.05, 0, neumann, 1.5}, r.across = {25, dy, 0.05, 0, neumann, dirichlet};
  r.reaction = 0.2;
  r.b = 20 * Vector::Unit(25, 0), r.n = Vector::Unit(25, 0);
  r.written_out = true;
  for (const double v : {0.0, -0.04}) {
    Scene scene = parse_sections(text(v == 0 ? "" : "advection = [-0.04, -0.04]\n")).scene;
    r.along.advection = r.across.advection = v;
    Scene written = scene;
    written.dynamics = r;
    EXPECT_EQ(holds<KroneckerDynamics>(scene.dynamics), v == 0);
    const Result found = run(scene, Method::march, 64);
    EXPECT_EQ(found.kernel.find("symmetric form") != std::string::npos, v != 0) << found.kernel;
    EXPECT_LT(distance(found.y.bottomRows(64), solved_y(written, Method::march, 64).bottomRows(64)),
              1e-8 * found.y.maxCoeff());
  }
}

TEST(SceneRectangles, RectanglesOfTwoDifferentSides) {
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

TEST(SceneRectangles, BoxesAreTheBuiltInOne) {
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

TEST(SceneRectangles, BoxesWithEndsOfTheirOwnAreWrittenOut) {
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

TEST(SceneRectangles, RectanglesHaveEndsOfTheirOwn) {
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

TEST(SceneRectangles, LinesAndSourcesOfRectangles) {
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

}  // namespace
}  // namespace bromwich
