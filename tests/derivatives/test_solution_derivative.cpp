// Derivatives against central differences of solves with changed data, and the two directions against each other.

#include "derivatives/solution_derivative.hpp"

#include "catalogue/catalogue.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace bromwich::derivatives_test {
namespace {

using reference::Random;

constexpr Index J = 60;

Result solved(const Scene& scene, Method method = Method::march) {
  Options options;
  options.steps = J;
  options.method = method;
  options.states = StateSelection::all;
  options.trace = true;
  return solve(scene, *make_cpu_backend(1), options);
}

// Linear between the time points, as the steps take it.
TimeFunction with_table(const TimeFunction& given, const RowMatrix& table, double T, double by) {
  return [=](double t, Eigen::Ref<Vector> v) {
    v.setZero();
    if (given) given(t, v);
    const double at = std::clamp(t / T, 0.0, 1.0) * J, below = std::min(std::floor(at), double(J - 1));
    v += by * ((1 - at + below) * table.row(Index(below)) + (at - below) * table.row(Index(below) + 1)).transpose();
  };
}

Scene drawn(unsigned seed) {
  Random random(seed);
  const Index m = 4, n = 3;
  Scene scene;
  const Matrix P = random.matrix(n, n);
  scene.dynamics =
      DenseDynamics{random.matrix(m, m) - Matrix::Identity(m, m), random.matrix(m, n), random.matrix(n, m)};
  scene.M = Matrix(P * P.transpose() + Matrix::Identity(n, n));
  scene.x0 = random.vector(m);
  scene.T = 3;
  const Vector phase = 3 * random.vector(n), strength = random.vector(m);
  scene.g = [phase](double t, Eigen::Ref<Vector> g) { g = (2.3 * t + phase.array()).sin().matrix(); };
  scene.f = [strength](double t, Eigen::Ref<Vector> f) { f = std::cos(1.7 * t) * strength; };
  return scene;
}

DataChange drawn_change(unsigned seed, Index m, Index n) {
  Random random(1000 + seed);
  return {random.vector(m),    random.matrix(J + 1, m), random.matrix(J + 1, n), random.matrix(m, m),
          random.matrix(m, n), random.matrix(n, m),     random.matrix(n, n),     {}};
}

Scene changed(const Scene& scene, const DataChange& c, double by) {
  Scene other = scene;
  DenseDynamics d = *scene.dynamics->small_state();
  if (c.A.size() > 0) d.A += by * c.A;
  if (c.B.size() > 0) d.B += by * c.B;
  if (c.N.size() > 0) d.N += by * c.N;
  other.dynamics = d;
  if (c.M.size() > 0) other.M = Matrix(to_dense(scene.M) + by * c.M);
  if (c.x0.size() > 0) other.x0 += by * c.x0;
  if (c.f.size() > 0) other.f = with_table(scene.f, c.f, scene.T, by);
  if (c.g.size() > 0) other.g = with_table(scene.g, c.g, scene.T, by);
  return other;
}

double dot(const RowMatrix& a, const RowMatrix& b) { return a.cwiseProduct(b).sum(); }

double dot(const DataChange& a, const DataChange& b) {
  return a.x0.dot(b.x0) + dot(a.f, b.f) + dot(a.g, b.g) + a.A.cwiseProduct(b.A).sum() + a.B.cwiseProduct(b.B).sum() +
         a.N.cwiseProduct(b.N).sum() + a.M.cwiseProduct(b.M).sum();
}

// The part of a change that only one of its members has.
DataChange only(const DataChange& all, int member) {
  DataChange one;
  if (member == 0) one.x0 = all.x0;
  if (member == 1) one.f = all.f;
  if (member == 2) one.g = all.g;
  if (member == 3) one.A = all.A;
  if (member == 4) one.B = all.B;
  if (member == 5) one.N = all.N;
  if (member == 6) one.M = all.M;
  return one;
}

class OfDrawnScenes : public ::testing::TestWithParam<unsigned> {};

TEST_P(OfDrawnScenes, AgreeWithDifferences) {
  const Scene scene = drawn(GetParam());
  const SolutionDerivative derivative(scene, solved(scene));
  ASSERT_GT(derivative.margin().margin, 1e-4) << "the sets must not change within the differences";
  const DataChange all = drawn_change(GetParam(), 4, 3);
  // Central differences: rounding 1e-14 / step and curvature step^2, both below 1e-8.
  const double step = 1e-6 * std::min(1.0, 100 * derivative.margin().margin);
  for (int member = 0; member < 7; ++member) {
    const DataChange c = only(all, member);
    const SolutionChange d = derivative.jvp(c);
    const Result up = solved(changed(scene, c, step)), down = solved(changed(scene, c, -step));
    ASSERT_EQ(up.status, Status::solved);
    const RowMatrix y = (up.y - down.y) / (2 * step), x = (up.x - down.x) / (2 * step);
    EXPECT_LE((d.y - y).norm(), 1e-6 * (1 + y.norm())) << member;
    EXPECT_LE((d.x - x).norm(), 1e-6 * (1 + x.norm())) << member;
  }
}

TEST_P(OfDrawnScenes, BackwardIsTheTransposeOfForward) {
  const Scene scene = drawn(GetParam());
  const SolutionDerivative derivative(scene, solved(scene, Method::contour));
  const DataChange c = drawn_change(GetParam() + 1, 4, 3);
  Random random(GetParam() + 7);
  const SolutionChange of{random.matrix(J + 1, 3), random.matrix(J + 1, 4), random.matrix(J + 1, 3),
                          random.matrix(J + 1, 3)};
  const SolutionChange forward = derivative.jvp(c);
  const DataChange gradient = derivative.vjp(of);
  const double value =
      dot(of.y, forward.y) + dot(of.x, forward.x) + dot(of.w, forward.w) + dot(of.integral, forward.integral);
  const auto square = [](const SolutionChange& s) {
    return dot(s.y, s.y) + dot(s.x, s.x) + dot(s.w, s.w) + dot(s.integral, s.integral);
  };
  const double size = std::sqrt(square(of) * square(forward));
  EXPECT_NEAR(dot(gradient, c), value, 1e-12 * size);
}

INSTANTIATE_TEST_SUITE_P(Derivatives, OfDrawnScenes, ::testing::Range(1u, 9u));

TEST(SolutionDerivative, WVanishesWhereYActs) {
  const Scene scene = drawn(3);
  const Result r = solved(scene);
  const SolutionChange d = SolutionDerivative(scene, r).jvp(drawn_change(3, 4, 3));
  for (Index j = 0; j <= J; ++j)
    for (Index i = 0; i < 3; ++i) {
      if (r.y(j, i) > 0) {
        EXPECT_NEAR(d.w(j, i), 0, 1e-12 * (1 + d.w.row(j).norm() + d.y.row(j).norm()));
      } else
        EXPECT_EQ(d.y(j, i), 0);
    }
}

// With a mass matrix: against differences, and the transpose.
TEST(SolutionDerivative, OfAMassMatrix) {
  const Matrix change = Random(77).matrix(4, 4);
  const auto with = [&](double by) {
    Scene scene = drawn(5);
    DenseDynamics d = *scene.dynamics->small_state();
    d.E = Matrix(2 * Matrix::Identity(4, 4)) + 0.3 * Random(7).matrix(4, 4) + by * change;
    scene.dynamics = d;
    return scene;
  };
  const SolutionDerivative derivative(with(0), solved(with(0)));
  ASSERT_GT(derivative.margin().margin, 1e-4);
  DataChange c;
  c.E = change;
  const SolutionChange d = derivative.jvp(c);
  const double step = 1e-6;
  const Result up = solved(with(step)), down = solved(with(-step));
  EXPECT_LE(((up.x - down.x) / (2 * step) - d.x).norm(), 1e-6 * d.x.norm());
  EXPECT_LE(((up.y - down.y) / (2 * step) - d.y).norm(), 1e-6 * d.y.norm());
  c = drawn_change(8, 4, 3);
  c.E = change;
  const SolutionChange of{Random(9).matrix(J + 1, 3), Random(10).matrix(J + 1, 4), {}, {}}, forward = derivative.jvp(c);
  const DataChange gradient = derivative.vjp(of);
  const double value = dot(of.y, forward.y) + dot(of.x, forward.x);
  EXPECT_NEAR(dot(gradient, c) + gradient.E.cwiseProduct(c.E).sum(), value,
              1e-12 * std::sqrt(dot(of.y, of.y) + dot(of.x, of.x)) *
                  std::sqrt(dot(forward.y, forward.y) + dot(forward.x, forward.x)));
}

// Two lines of cells: a Kronecker sum that the derivative writes out.
TEST(SolutionDerivative, OfAKroneckerSum) {
  const auto with = [](double by) {
    Scene scene = make_scene("signorini", {{"Q", 7}});
    scene.M = Matrix(0.5 * Matrix::Identity(scene.constraints(), scene.constraints()));
    const TimeFunction g = scene.g;
    const Index n = scene.constraints();
    scene.g = [g, n, by](double t, Eigen::Ref<Vector> v) {
      v.setZero();
      if (g) g(t, v);
      v += by * Vector::Ones(n);
    };
    return scene;
  };
  const SolutionDerivative derivative(with(0), solved(with(0)));
  DataChange c;
  c.g = RowMatrix::Ones(J + 1, derivative.steps() > 0 ? with(0).constraints() : 0);
  const SolutionChange d = derivative.jvp(c);
  ASSERT_GT(d.y.norm(), 1e-3);
  const double step = std::min(1e-6, 0.1 * derivative.margin().margin);
  const Result up = solved(with(step)), down = solved(with(-step));
  EXPECT_LE(((up.y - down.y) / (2 * step) - d.y).norm(), 1e-6 * d.y.norm());
  SolutionChange of;
  of.y = Random(4).matrix(J + 1, with(0).constraints());
  EXPECT_NEAR(dot(derivative.vjp(of).g, c.g), dot(of.y, d.y), 1e-12 * of.y.norm() * d.y.norm());
}

// From rest, y_i = w_i = 0 at t = 0: changes that leave w(0) have a derivative, others are refused.
TEST(SolutionDerivative, FromRest) {
  const Scene scene = make_scene("dlcp-small");
  const SolutionDerivative derivative(scene, solved(scene));
  const Index n = scene.constraints();
  DataChange c;
  c.M = Matrix::Identity(n, n);  // M stays a Z-matrix
  const SolutionChange d = derivative.jvp(c);
  const double step = std::min(1e-6, 1e-2 * derivative.margin().margin);
  const Result up = solved(changed(scene, c, step)), down = solved(changed(scene, c, -step));
  EXPECT_LE(((up.y - down.y) / (2 * step) - d.y).norm(), 1e-6 * d.y.norm());
  c = {};
  c.x0 = Vector::Ones(scene.states());
  EXPECT_NE(refusal([&] { derivative.jvp(c); }).find("at t = 0"), std::string::npos);
  // The gradient has the data that leave w(0).
  Random random(7);
  SolutionChange of;
  of.y = random.matrix(J + 1, n), of.x = random.matrix(J + 1, scene.states());
  const DataChange bar = derivative.vjp(of);
  EXPECT_EQ(bar.x0.size(), 0);
  EXPECT_EQ(bar.g.size(), 0);
  c = {};
  c.A = random.matrix(scene.states(), scene.states()), c.B = random.matrix(scene.states(), n);
  c.f = random.matrix(J + 1, scene.states());
  const SolutionChange out = derivative.jvp(c);
  EXPECT_NEAR(bar.A.cwiseProduct(c.A).sum() + bar.B.cwiseProduct(c.B).sum() + dot(bar.f, c.f),
              dot(of.y, out.y) + dot(of.x, out.x), 1e-12 * (of.y.norm() * out.y.norm() + of.x.norm() * out.x.norm()));
}

// x' = 30 x - 40 y, w = y - x from x0 = 2: y = x and x' = -10 x.
TEST(SolutionDerivative, OfAnUnstableStateThatTheConstraintHolds) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{30}}, Matrix{{-40}}, Matrix{{-1}}};
  scene.M = Matrix{{1}};
  scene.x0 = Vector{{2}};
  scene.T = 1;
  const SolutionDerivative derivative(scene, solved(scene));
  DataChange c;
  c.x0 = Vector{{1}};
  const SolutionChange d = derivative.jvp(c);
  const Result r = solved(scene);
  for (Index j = 0; j <= J; ++j) EXPECT_NEAR(2 * d.x(j, 0), r.x(j, 0), 1e-9 * r.x(0, 0));
}

TEST(SolutionDerivative, SaysWhereThereIsNone) {
  // A relay: y jumps.
  Scene relay = make_scene("dlcp-small");
  relay.M = Matrix::Zero(relay.constraints(), relay.constraints());
  const Result jumping = solved(relay);
  EXPECT_NE(refusal([&] { SolutionDerivative(relay, jumping); }), "nothing was refused");
  // y = w = 0 for all t.
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  scene.x0 = Vector{{0}};
  const Result rest = solved(scene);
  EXPECT_NE(refusal([&] { SolutionDerivative(scene, rest); }).find("one-sided"), std::string::npos);
  Result failed = rest;
  failed.status = Status::infeasible;
  EXPECT_NE(refusal([&] { SolutionDerivative(scene, failed); }).find("infeasible"), std::string::npos);
}

// No constraint sees the state that f drives: w alone does not show that the steps leave the jump out.
// w = (0.3 + 4e-17) x_0 - 0.3 x_1 with x_0 = x_1 is rounding of its terms at all times, and no distance from y = w = 0.
TEST(SolutionDerivative, TakesRoundingOfWForNoMargin) {
  Scene scene;
  scene.dynamics = DenseDynamics{-Matrix::Identity(2, 2), Matrix::Zero(2, 1), Matrix{{0.1 + 0.2, -0.3}}};
  scene.M = Matrix::Identity(1, 1);
  scene.x0 = Vector::Ones(2);
  scene.T = 1;
  const Result r = solved(scene);
  ASSERT_EQ(r.status, Status::solved);
  ASSERT_LE(r.y.cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_NE(refusal([&] { SolutionDerivative(scene, r); }).find("y_0 = w_0 = 0"), std::string::npos);
}

TEST(SolutionDerivative, RefusesSourcesThatJump) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1, 0}, {0, -2}}, Matrix{{0}, {1}}, Matrix{{0, 1}}};
  scene.M = Matrix{{1}};
  scene.x0 = Vector{{1, 0.5}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = std::sin(5 * t + 1); };
  scene.T = 3;
  for (const double jump : {1.0, 1.01}) {  // at a time point, and inside a step
    scene.f = [jump](double t, Eigen::Ref<Vector> v) { v << (t < jump ? 1 : 2), 0; };
    scene.breakpoints = {jump};
    const Result r = solved(scene);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_NE(refusal([&] { SolutionDerivative(scene, r); }).find("jumps or bends"), std::string::npos) << jump;
  }
  scene.breakpoints.clear();
  scene.f = [](double t, Eigen::Ref<Vector> v) { v << std::cos(2 * t), 0; };
  EXPECT_EQ(refusal([&] { SolutionDerivative(scene, solved(scene)); }), "nothing was refused");
}

TEST(SolutionDerivative, RefusesTablesOfOtherSizes) {
  const Scene scene = drawn(1);
  const SolutionDerivative derivative(scene, solved(scene));
  DataChange c;
  c.g = RowMatrix::Zero(J, 3);
  EXPECT_EQ(refusal([&] { derivative.jvp(c); }), "g: found 60 x 3; give 61 x 3");
  SolutionChange of;
  of.x = RowMatrix::Zero(J + 1, 3);
  EXPECT_EQ(refusal([&] { derivative.vjp(of); }), "x: found 61 x 3; give 61 x 4");
  c.g = RowMatrix::Zero(J + 1, 3);
  c.x0 = Vector::Constant(4, NAN);
  EXPECT_EQ(refusal([&] { derivative.jvp(c); }), "x0: has an entry that is not finite; give finite numbers");
  of.x = RowMatrix::Zero(J + 1, 4);
  of.y = RowMatrix::Constant(J + 1, 3, INFINITY);
  EXPECT_EQ(refusal([&] { derivative.vjp(of); }), "y: has an entry that is not finite; give finite numbers");
}

}  // namespace
}  // namespace bromwich::derivatives_test
