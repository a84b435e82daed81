// What differences of grids do not show: contacts that all grids miss, jumps of g inside steps, chance. Dense, sparse
// and Kronecker scenes.

#include "tests/support/run.hpp"

#include <Eigen/LU>

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

Options options_to(double tolerance, Method method) {
  Options options = options_for(method);
  options.tolerance = tolerance;
  return options;
}

// Decaying states, of which y moves one: m > 512 stays sparse, fewer are written out.
SparseDynamics one_of_many(Index m) {
  SparseDynamics d;
  d.A.resize(m, m), d.B.resize(m, 1), d.N.resize(1, m);
  for (Index i = 0; i < m; ++i) d.A.insert(i, i) = -1;
  d.B.insert(0, 0) = d.N.insert(0, 0) = 1;
  return d;
}

// A jump of g inside steps of a sparse scene.
TEST(ErrorsOfGrids, JumpsInsideStepsOfSparseScenesTakeMoreSteps) {
  constexpr Index m = 520;  // above 512 sparse dynamics stay sparse
  SparseDynamics d;
  d.A.resize(m, m), d.B.resize(m, 1), d.N.resize(1, m);
  for (Index i = 0; i < m; ++i) d.A.insert(i, i) = -1 - double(i) / m;
  d.B.insert(0, 0) = 1;
  d.N.insert(0, 0) = 1;
  Scene scene;
  scene.dynamics = d;
  scene.M = Matrix{{1}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = t < 0.31234 ? -1 : 1; };
  scene.x0 = Vector::Zero(m);
  scene.T = 1;
  scene.default_steps = 20;
  for (const Method method : {Method::march, Method::multigrid}) {
    const Result r = run(scene, options_to(2e-3, method));
    ASSERT_EQ(r.status, Status::solved) << to_string(method) << ": " << r.reason;
    // x_0' = -x_0 + (1 - x_0) up to the jump, then y = 0.
    for (Index j = 0; j <= r.steps; ++j)
      if (std::abs(r.t[j] - 0.31234) > r.t[1]) {
        const double y = r.t[j] < 0.31234 ? 1 - 0.5 * (1 - std::exp(-2 * r.t[j])) : 0;
        EXPECT_NEAR(r.y(j, 0), y, 3 * 2e-3) << to_string(method) << r.t[j];
      }
  }
}

// The same where g jumps while w > 0: y does not feel it, and the differences of the first grids are below the
// tolerance. x_0' = -x_0 + y, y = 0 up to t = 3/4, then y = 8t - 6 - x_0 and x_0 = 4t - 5 + 2 e^{3/2 - 2t}.
TEST(ErrorsOfGrids, JumpsOfGBesideContactsTakeMoreStepsToo) {
  Scene scene;
  scene.dynamics = one_of_many(520);
  scene.M = Matrix{{1}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = (t < 0.31234 ? 7 : 2) + 4 - 8 * t; };
  scene.x0 = Vector::Zero(520);
  scene.T = 1;
  scene.default_steps = 20;
  for (const Method method : {Method::march, Method::multigrid, Method::contour}) {
    Options options = options_to(1e-3, method);
    options.iteration_tolerance = 1e-6;  // sweeps may end after the first one: they go on where that says too little
    const Result r = run(scene, options);
    ASSERT_EQ(r.status, Status::solved) << to_string(method) << ": " << r.reason;
    for (Index j = 0; j <= r.steps; ++j) {
      const double t = r.t[j], y = t < 0.75 ? 0 : 4 * t - 1 - 2 * std::exp(1.5 - 2 * t);
      EXPECT_NEAR(r.y(j, 0), y, 3 * 1e-3) << to_string(method) << t;  // y is at most 1.8
    }
  }
}

// A fast mode follows half waves of f, in a scene with 2 states that N sees and 600 that it does not. That the points
// of two grids fall well beside the kinks makes their difference small by chance: less than a tenth of the one before.
TEST(ErrorsOfGrids, SuddenFallsOfTheEstimateAreNotBelieved) {
  constexpr Index m = 602;
  SparseDynamics sparse;
  sparse.A.resize(m, m), sparse.B.resize(m, 1), sparse.N.resize(1, m);
  sparse.A.insert(0, 0) = -912.5093574251528;
  sparse.A.insert(1, 1) = -0.2432591791161091;
  for (Index i = 2; i < m; ++i) sparse.A.insert(i, i) = -2;
  sparse.B.insert(0, 0) = 912.5093574251528, sparse.B.insert(1, 0) = -0.6051698090893436;
  sparse.N.insert(0, 0) = 1, sparse.N.insert(0, 1) = 0.35247149283386714;
  Scene scene;
  scene.dynamics = sparse;
  scene.M = Matrix{{0.4057412019063411}};
  scene.f_entry = SourceEntry::through_F;
  scene.F.resize(m, 1);
  scene.F.insert(0, 0) = 1;
  scene.f = [](double t, Eigen::Ref<Vector> f) {
    f[0] =
        -1894.9194605389116 * std::max(0.0, std::sin(23.78931198503493 * t + 2.620395934808284)) - 1623.1911524576574;
  };
  scene.g = [](double t, Eigen::Ref<Vector> g) { g[0] = -0.2477643 + 0.3952033 * t; };
  for (int k = 1; (k * std::numbers::pi - 2.620395934808284) / 23.78931198503493 < 1; ++k)
    scene.breakpoints.push_back((k * std::numbers::pi - 2.620395934808284) / 23.78931198503493);
  scene.x0 = Vector::Zero(m);
  scene.x0[0] = 0.78181646;
  scene.T = 1;
  Scene seen = scene;  // the first two states alone, by located events
  seen.dynamics =
      DenseDynamics{Matrix(sparse.A).topLeftCorner(2, 2), Matrix(sparse.B).topRows(2), Matrix(sparse.N).leftCols(2)};
  seen.F = scene.F.topRows(2);
  seen.x0 = scene.x0.head(2);
  Options options = options_to(1e-2, Method::march);
  options.components = {0, 1};
  const Result r = run(scene, options);
  options = options_to(1e-8, Method::events);
  options.steps = r.steps;
  options.states = StateSelection::all;
  const Result truth = run(seen, options);
  ASSERT_EQ(truth.status, Status::solved) << truth.reason;
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_EQ(truth.steps % r.steps, 0);
  const Index stride = truth.steps / r.steps;
  double largest = 0, error = 0;
  for (Index j = 1; j <= r.steps; ++j) {
    largest = std::max(largest, std::abs(truth.y(stride * j, 0)));
    error = std::max(error, std::abs(r.y(j, 0) - truth.y(stride * j, 0)));
  }
  EXPECT_LE(error, 1e-2 * largest) << r.steps << " steps, estimate " << *r.error_estimate;
}

// Agreement of two grids that both miss a contact does not prove that there is none.
// x = e^{rt} v with v = s (rI - A)^{-1} B 1 and max N v = 1, y_i = max(S, 0), w_i = max(-S, 0) with S = cos(2 pi t /
// T), for any A, B, N and M = I: where the error of N x, relative to e^{rT}, is larger than y, y = 0 on all coarse
// grids, and their differences are 0. `matrices`: those of the dynamics.
Scene small_y_beside_growth(Dynamics dynamics, const SparseDynamics& matrices, double r) {
  static constexpr double T = 5;
  const auto S = [](double t) { return std::cos(2 * std::numbers::pi * t / T); };
  const Index m = matrices.A.rows(), n = matrices.N.rows();
  const Matrix shifted = r * Matrix::Identity(m, m) - Matrix(matrices.A);
  const Vector to_one = shifted.partialPivLu().solve(Vector(matrices.B * Vector::Ones(n)));
  const double s = 1 / Vector(matrices.N * to_one).maxCoeff();
  const Vector v = s * to_one, seen = matrices.N * v;
  Scene scene;
  scene.dynamics = std::move(dynamics);
  scene.M = Matrix(Matrix::Identity(n, n));
  scene.f_entry = SourceEntry::through_B;
  scene.f = [=](double t, Eigen::Ref<Vector> f) { f.setConstant(s * std::exp(r * t) - std::max(S(t), 0.0)); };
  scene.g = [=](double t, Eigen::Ref<Vector> g) { g = (-S(t) - std::exp(r * t) * seen.array()).matrix(); };
  scene.exact = [=](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
    x = std::exp(r * t) * v;
    y.setConstant(std::max(S(t), 0.0));
  };
  scene.breakpoints = {T / 4, 3 * T / 4};
  scene.x0 = v;
  scene.T = T;
  return scene;
}

void expect_the_tolerance(const Scene& scene, Method method, double tolerance) {
  Options options = options_to(tolerance, method);
  const Result r = run(scene, options);
  ASSERT_EQ(r.status, Status::solved) << to_string(method) << ": " << r.reason;
  EXPECT_EQ(r.trace.size(), 0) << "N x, which nobody asked for";
  Vector x(scene.states()), y(scene.constraints());
  double error = 0;
  for (Index j = 1; j <= r.steps; ++j) {
    scene.exact(r.t[j], x, y);
    error = std::max(error, (r.y.row(j).transpose() - y).cwiseAbs().maxCoeff());
  }
  EXPECT_LE(error, tolerance) << to_string(method);
  EXPECT_GE(*r.error_estimate, error / 3) << to_string(method);
}

TEST(ErrorsOfGrids, SeesWhatErrorsOfWHide) {
  const DenseDynamics d{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  const Scene scene = small_y_beside_growth(d, one_of_many(1), 3);
  for (const Method method : {Method::march, Method::contour})
    for (const double tolerance : {1e-1, 1e-2}) expect_the_tolerance(scene, method, tolerance);
}

// Dense with more states than are recorded, sparse, a Kronecker sum.
TEST(ErrorsOfGrids, SeesWhatErrorsOfWHideInLargeScenes) {
  constexpr double r = 2.2, tolerance = 1e-1;
  for (const Index m : {70, 520})
    expect_the_tolerance(small_y_beside_growth(one_of_many(m), one_of_many(m), r), Method::march, tolerance);
  const KroneckerDynamics d{{3, 0.25, 0.05}, {4, 0.25, 0.05}, Vector::Unit(4, 0), Vector::Unit(4, 0)};
  for (const Method method : {Method::march, Method::multigrid})
    expect_the_tolerance(small_y_beside_growth(d, to_sparse(d), r), method, tolerance);
}

}  // namespace
}  // namespace bromwich
