// Mixed problems: rows with w = 0 and free y beside complementary rows. Each step of implicit Euler is compared with an
// enumeration of the active sets of the whole mixed problem, the other methods with a prescribed solution and with each
// other.

#include "core/solve/dense_output.hpp"
#include "core/solve/mixed.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>
#include <Eigen/LU>

#include <cmath>

namespace bromwich {
namespace {

using reference::pi;

/// y with y_C >= 0 ⊥ w_C >= 0 and w_F = 0, w = M y + q: all active sets that contain F; the smallest residual wins.
Vector mixed_lcp(const Matrix& M, const Vector& q, const std::vector<Index>& free) {
  const Index n = q.size();
  double best = INFINITY;
  Vector found = Vector::Constant(n, NAN);
  for (unsigned set = 0; set < 1u << n; ++set) {
    const std::vector<Index> S = oracle::members(set, n);
    if (!std::includes(S.begin(), S.end(), free.begin(), free.end())) continue;
    Vector y = Vector::Zero(n);
    if (!S.empty()) y(S) = Vector(Matrix(M(S, S)).fullPivLu().solve(Vector(-q(S))));
    const Vector w = M * y + q;
    double residual = 0;
    for (Index i = 0; i < n; ++i)
      residual =
          std::max(residual, std::abs(std::binary_search(free.begin(), free.end(), i) ? w[i] : std::min(y[i], w[i])));
    if (residual < best) {
      best = residual;
      found = y;
    }
  }
  return found;
}

/// x_j = x_{j-1} + h (A x_j + B y_j + f_j) with the whole mixed problem at every step.
RowMatrix euler_by_enumeration(const Scene& scene, Index J, RowMatrix& states) {
  const oracle::DenseScene s = oracle::write_out(scene);
  const Index m = s.A.rows(), n = s.M.rows();
  const double h = s.T / double(J);
  const Matrix D = (Matrix::Identity(m, m) - h * s.A).inverse();
  RowMatrix y(J + 1, n);
  states.resize(J + 1, m);
  Vector x = s.x0;
  for (Index j = 0; j <= J; ++j) {
    const double t = h * double(j);
    const Vector start = j == 0 ? x : Vector(D * (x + h * oracle::value(s.f, t, m)));
    const Matrix drive = j == 0 ? Matrix::Zero(m, n) : Matrix(h * D * s.B);
    const Vector found = mixed_lcp(s.M + s.N * drive, s.N * start + oracle::value(s.g, t, n), scene.free_rows);
    x = start + drive * found;
    y.row(j) = found.transpose();
    states.row(j) = x.transpose();
  }
  return y;
}

/// A random P-scene with equations in the rows `free`, and sources of both kinds.
Scene random_mixed(std::uint32_t seed, Index m, Index n, const std::vector<Index>& free) {
  Scene scene = oracle::random_scene(seed, m, n, oracle::SpectrumKind::sector, oracle::MatrixKind::positive_definite);
  scene.free_rows = free;
  return scene;
}

TEST(Mixed, ImplicitEulerAgreesWithEnumeration) {
  for (std::uint32_t seed = 1; seed <= 12; ++seed) {
    const std::vector<std::vector<Index>> choices{{0}, {1, 3}, {2}, {0, 1, 2, 3}};
    const Scene scene = random_mixed(seed, 3, 4, choices[seed % 4]);
    RowMatrix states;
    const RowMatrix expected = euler_by_enumeration(scene, 24, states);
    Options options = options_for(Method::euler, 24);
    options.states = StateSelection::all;
    options.trace = true;
    const Result result = run(scene, options);
    ASSERT_EQ(result.status, Status::solved) << result.reason;
    EXPECT_LE(distance(result.y, expected), same_problem) << seed;
    EXPECT_LE(distance(result.x, states), same_problem) << seed;
    const oracle::DenseScene s = oracle::write_out(scene);
    EXPECT_LE(distance(result.trace, states * s.N.transpose()), same_problem) << seed;
    EXPECT_LE(result.residual, 1e-13);
  }
}

/// Prescribes x, y_C, w_C and y_F; f and g follow.
Scene prescribed(bool sparse, SourceEntry entry) {
  const Matrix A{{-1, 2, 0}, {-2, -1, 1}, {0, 0, -3}}, B{{1, 0, 1}, {0, 1, -1}, {1, 1, 1}},
      N{{1, 0, 1}, {0, 1, 0}, {1, -1, 0}};
  const Matrix M{{2, 1, 0}, {-1, -2, 1}, {0, 1, 3}};  // M_FF = -2, the rest P after elimination
  const auto x = [](double t) { return Vector{{std::cos(t), std::sin(2 * t), 1 + t * t}}; };
  const auto dx = [](double t) { return Vector{{-std::sin(t), 2 * std::cos(2 * t), 2 * t}}; };
  const auto y = [](double t) { return Vector{{std::max(std::sin(2 * pi * t), 0.), std::cos(3 * t) - 0.5, 0.25}}; };
  const auto w = [](double t) { return Vector{{std::max(-std::sin(2 * pi * t), 0.), 0, 0}}; };
  Scene scene;
  scene.name = "prescribed";
  scene.dynamics = DenseDynamics{A, B, N};
  if (sparse) scene.dynamics = SparseDynamics{A.sparseView(), B.sparseView(), N.sparseView()};
  scene.M = M;
  scene.free_rows = {1};
  const auto f = [=](double t) { return Vector(dx(t) - A * x(t) - B * y(t)); };
  scene.f = [f](double t, Eigen::Ref<Vector> value) { value = f(t); };
  scene.f_entry = entry;
  if (entry == SourceEntry::through_F) {
    const Matrix F{{2, 0, 0}, {1, 1, 0}, {0, 0, -1}};
    scene.F = F.sparseView();
    scene.f = [f, inverse = Matrix(F.inverse())](double t, Eigen::Ref<Vector> value) { value = inverse * f(t); };
  } else if (entry == SourceEntry::through_B) {
    scene.f = [f, inverse = Matrix(B.inverse())](double t, Eigen::Ref<Vector> value) { value = inverse * f(t); };
  }
  scene.g = [=](double t, Eigen::Ref<Vector> value) { value = w(t) - N * x(t) - M * y(t); };
  scene.x0 = x(0);
  scene.T = 1;
  scene.default_steps = 64;
  scene.exact = [=](double t, Eigen::Ref<Vector> state, Eigen::Ref<Vector> control) {
    state = x(t);
    control = y(t);
  };
  return scene;
}

double error(const Scene& scene, const Result& result) {
  double largest = 0;
  Vector x(scene.states()), y(scene.constraints());
  for (Index j = 0; j < result.t.size(); ++j) {
    scene.exact(result.t[j], x, y);
    largest = std::max({largest, (result.y.row(j).transpose() - y).cwiseAbs().maxCoeff(),
                        (result.x.row(j).transpose() - x).cwiseAbs().maxCoeff()});
  }
  return largest;
}

Result with_states(const Scene& scene, Method method, Index steps) {
  Options options = options_for(method, steps);
  options.states = StateSelection::all;
  return run(scene, options);
}

TEST(Mixed, EverySourceEntryHasTheOrderOfMarching) {
  for (const SourceEntry entry : {SourceEntry::state, SourceEntry::through_F, SourceEntry::through_B})
    for (const bool sparse : {false, true}) {
      const Scene scene = prescribed(sparse, entry);
      const Result coarse = with_states(scene, Method::march, 64), fine = with_states(scene, Method::march, 128);
      ASSERT_EQ(fine.status, Status::solved) << fine.reason;
      // Kinks of y lie on nodes: second order, also for the eliminated unknowns.
      EXPECT_NEAR(std::log2(error(scene, coarse) / error(scene, fine)), 2, 0.1) << int(entry) << sparse;
      EXPECT_LE(error(scene, fine), 1e-3);
    }
}

TEST(Mixed, MethodsOfOneDiscretisationAgree) {
  const Scene scene = prescribed(false, SourceEntry::state);
  const RowMatrix y = solved_y(scene, Method::march, 64);
  EXPECT_LE(distance(solved_y(scene, Method::contour, 64), y), same_problem);
  EXPECT_LE(distance(solved_y(scene, Method::multigrid, 64), y), same_problem);
  EXPECT_LE(distance(solved_y(scene, Method::automatic, 64), y), same_problem);
}

TEST(Mixed, OfAKroneckerSumToo) {
  KroneckerDynamics d{{3, 0.25, 0.1}, {2, 0.25, 0.1}, Vector{{1, 0}}, Vector{{1, 0}}};
  Scene scene;
  scene.name = "kronecker";
  scene.dynamics = d;
  scene.M = reference::tridiagonal(3, -1, 4, -1);
  scene.f_entry = SourceEntry::through_B;
  scene.f = [](double t, Eigen::Ref<Vector> phi) { phi << std::sin(3 * t), 1, -t; };
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << std::cos(4 * t), -1, std::sin(5 * t); };
  scene.x0 = Vector::Ones(6);
  scene.free_rows = {1};
  Scene dense = scene;
  dense.dynamics = to_dense(scene.dynamics);
  EXPECT_LE(distance(solved_y(scene, Method::march, 32), solved_y(dense, Method::march, 32)), same_problem);
}

TEST(Mixed, EveryRowFreeIsALinearSystem) {
  Scene scene;
  scene.name = "linear";
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{2}}};
  scene.M = Matrix{{-1}};
  scene.free_rows = {0};  // y = 2 x, x' = x
  scene.x0 = Vector{{1}};
  const Result result = with_states(scene, Method::automatic, 10);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  ASSERT_EQ(result.y.cols(), 1);
  EXPECT_NEAR(result.x(10, 0), std::exp(1.), 1e-13);
  EXPECT_NEAR(result.y(10, 0), 2 * std::exp(1.), 1e-13);
}

TEST(Mixed, StatesAreOnlyThoseAskedFor) {
  const Scene scene = prescribed(false, SourceEntry::state);
  Options options = options_for(Method::march, 64);
  EXPECT_EQ(run(scene, options).x.cols(), 0);
  options.states = StateSelection::list;
  options.components = {2, 0};
  const Result result = run(scene, options), all = with_states(scene, Method::march, 64);
  EXPECT_EQ(result.x_components, options.components);
  EXPECT_EQ(distance(result.x, all.x(Eigen::all, options.components)), 0);
  EXPECT_EQ(result.trace.size(), 0);
}

TEST(Mixed, StatesAtChosenTimesFollowTheSolution) {
  const Scene scene = prescribed(false, SourceEntry::state);
  const auto backend = make_cpu_backend(1);
  const Result result = with_states(scene, Method::march, 64);
  const Matrix x = states_at(scene, *backend, result, {17, 64});
  EXPECT_LE((x.col(0) - result.x.row(17).transpose()).cwiseAbs().maxCoeff(), same_problem);
  EXPECT_LE((x.col(1) - result.x.row(64).transpose()).cwiseAbs().maxCoeff(), same_problem);
  const Result between = at_times(scene, *backend, result, {0.3});
  // Linear between nodes: h^2/8 of the largest second derivative, (2 pi)^2.
  EXPECT_LE(error(scene, between), error(scene, result) + std::pow(2 * pi / 64, 2) / 8);
}

TEST(Mixed, ToleranceIsKeptByWhatWasEliminated) {
  const Scene scene = prescribed(false, SourceEntry::state);
  Options options = options_for(Method::march);
  options.tolerance = 1e-4;
  options.states = StateSelection::all;
  const Result result = run(scene, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  EXPECT_LE(error(scene, result), 1e-4);
  // All rows, including free ones, are smooth between kinks on grid points: the estimate is that of their own error.
  double of_y = 0;
  Vector x(scene.states()), y(scene.constraints());
  for (Index j = 1; j < result.t.size(); ++j) {
    scene.exact(result.t[j], x, y);
    of_y = std::max(of_y, (result.y.row(j).transpose() - y).cwiseAbs().maxCoeff());
  }
  of_y /= std::max(1.0, result.y.cwiseAbs().maxCoeff());
  EXPECT_GE(result.errors->total(), 0.5 * of_y);
  EXPECT_LE(result.errors->total(), 2 * of_y);
}

TEST(Mixed, SingularFreeRowsAreLeftToGalerkin) {
  Scene scene = prescribed(false, SourceEntry::state);
  scene.M = Matrix{{2, 1, 0}, {-1, 0, 1}, {0, 1, 3}};
  EXPECT_FALSE(eliminate_free(scene));
  const Result result = run(scene, Method::march, 16);
  EXPECT_EQ(result.status, Status::unsupported);
  EXPECT_EQ(result.reason, "the free rows and columns of M form a singular matrix; use method galerkin");
  EXPECT_EQ(result.y.rows(), 17);
  EXPECT_EQ(result.y.cols(), 3);
}

TEST(Mixed, RegularityDoesNotDependOnUnits) {
  Scene scene = prescribed(false, SourceEntry::state);
  Matrix M = to_dense(scene.M);
  M.row(1) *= 1e-12;
  scene.M = M;
  EXPECT_TRUE(eliminate_free(scene));
}

TEST(Mixed, BoundaryValuesAreRefusedByMethodsThatNeedInitialOnes) {
  Scene scene = prescribed(false, SourceEntry::state);
  scene.boundary = BoundaryCondition{Matrix::Identity(3, 3), -Matrix::Identity(3, 3), scene.x0};
  scene.x0 = {};
  for (const Method method :
       {Method::march, Method::contour, Method::multigrid, Method::euler, Method::contour_literal}) {
    const Result result = run(scene, method, 16);
    EXPECT_EQ(result.status, Status::unsupported);
    EXPECT_EQ(result.method, method);
    EXPECT_EQ(result.reason,
              "it needs initial values and the scene has boundary values; use method shooting or galerkin");
  }
}

}  // namespace
}  // namespace bromwich
