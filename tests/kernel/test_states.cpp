// States on request: components by observers, time points by contours, both against stepping.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/solve/dense_output.hpp"
#include "core/solve/solve.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace bromwich {
namespace {

// Rows of `result.x` (all components) against states_at.
void expect_same_states(const Scene& scene, Index steps) {
  Options options = options_for(Method::contour, steps);
  options.states = StateSelection::all;
  const auto backend = make_cpu_backend(1);
  const Result result = solve(scene, *backend, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  const std::vector<Index> rows{0, 1, std::min<Index>(2, steps), steps / 2, steps};
  const Matrix x = states_at(scene, *backend, result, rows);
  ASSERT_EQ(x.rows(), scene.states());
  for (std::size_t c = 0; c < rows.size(); ++c) {
    const double scale = std::max(1.0, result.x.row(rows[c]).cwiseAbs().maxCoeff());
    // Contours with 25 nodes are accurate to 7e-15 of the terms of their sums, up to `steps` lags of size 1.
    EXPECT_LE((x.col(Index(c)).transpose() - result.x.row(rows[c])).cwiseAbs().maxCoeff(), 1e-11 * scale)
        << scene.name << ", row " << rows[c];
  }
}

TEST(StatesAt, EqualTheObserversOfSignorini) {
  for (const double Q : {1, 2, 7, 39}) expect_same_states(make_scene("signorini", {{"Q", Q}}), 400);
  for (const Index steps : {1, 3, 5, 20}) expect_same_states(make_scene("signorini", {{"Q", 7}}), steps);
}

TEST(StatesAt, EqualSteppingOfDenseScenes) {
  expect_same_states(make_scene("dlcp-small"), 4000);  // by contours: few rows, many steps
  expect_same_states(make_scene("dlcp-small"), 100);
  expect_same_states(make_scene("bridge"), 600);
}

TEST(StatesAt, RefusesWhatItCannotDo) {
  const Scene scene = make_scene("signorini", {{"Q", 7}});
  const auto backend = make_cpu_backend(1);
  const Result march = solve(scene, *backend, options_for(Method::march, 16));
  EXPECT_THROW(states_at(scene, *backend, march, {17}), Error);
  EXPECT_THROW(states_at(scene, *backend, march, {-1}), Error);
  EXPECT_THROW(states_at(make_scene("bridge"), *backend, march, {1}), Error);
  EXPECT_THROW(states_at(scene, *backend, solve(scene, *backend, options_for(Method::euler, 16)), {1}), Error);
  EXPECT_EQ(states_at(scene, *backend, march, {}).cols(), 0);
}

// N x of the methods against N times the states, for every way to y. x' = 20 x - 40 y, w = -x + y: y = x, and x =
// e^{-20 t} in closed loop. The free state grows by e^{100}, and so would rounding errors of y.
Scene held_back() {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{20}}, Matrix{{-40}}, Matrix{{-1}}};
  scene.M = Matrix{{1}};
  scene.x0 = Vector{{1}};
  scene.T = 5;
  return scene;
}

TEST(States, OfAFreeStateThatGrowsComeFromTheClosedLoop) {
  const Scene scene = held_back();
  const auto backend = make_cpu_backend(1);
  for (const Method method : {Method::automatic, Method::march, Method::contour, Method::multigrid, Method::euler}) {
    Options options = options_for(method, 2000);
    options.states = StateSelection::all;
    const Result r = solve(scene, *backend, options);
    if (method == Method::automatic || method == Method::march) {
      ASSERT_EQ(r.status, Status::solved) << r.reason;
    }
    if (r.status != Status::solved || r.warning.find("x by about") != std::string::npos) continue;
    // h lambda = 0.05: second order has the error (h lambda)^2/12 of 20 t e^{-20 t} <= 1/e, Euler h lambda/2 of it.
    const double bound = method == Method::euler ? 0.02 : 1e-3;
    for (Index j = 0; j <= 2000; ++j) ASSERT_NEAR(r.x(j, 0), std::exp(-20 * r.t[j]), bound) << to_string(method) << j;
    EXPECT_LE(std::abs(r.x(2000, 0)), 1e-12) << to_string(method);
    if (method != Method::march) continue;
    EXPECT_LE(std::abs(states_at(scene, *backend, r, {2000})(0, 0)), 1e-12);
    const Result between = at_times(scene, *backend, r, {4.99875});
    EXPECT_LE(std::abs(between.x(0, 0)), 1e-12);
  }
}

// Twenty random scenes with unstable A and a decaying closed loop: the states agree with those of Radau IIA, which
// steps them.
TEST(States, OfUnstableScenesAreThoseThatAreStepped) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 20; ++trial) {
    const Index m = 2 + trial % 3;
    Scene scene;
    Matrix A = Matrix::NullaryExpr(m, m, [&] { return normal(random); });
    Matrix B = Matrix::NullaryExpr(m, 1, [&] { return normal(random); }), N = -B.transpose();
    A = (A - A.transpose()).eval() - Matrix::Identity(m, m);
    // A + 30 b b^T is unstable; y = x_b while x_b > 0 removes 60 b b^T. Below 0, y = 0 and the state diverges: g keeps
    // y positive.
    B.normalize();
    N = -B.transpose();
    scene.dynamics = DenseDynamics{A + 10 * B * B.transpose(), -20 * B, N};
    scene.M = Matrix{{1}};
    scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = -1; };
    scene.f = [B](double, Eigen::Ref<Vector> f) { f = 20 * B.col(0); };
    scene.x0 = 0.2 * B.col(0);
    scene.T = 8;
    Options options = options_for(Method::march, 8000);
    options.states = StateSelection::all;
    const Result r = run(scene, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    // y = 1 + b^T x throughout, so x' = (A - 10 b b^T) x.
    ASSERT_GT(r.y.minCoeff(), 0) << trial;
    const Matrix closed = A - 10 * B * B.transpose();
    const Vector expected = oracle::exponential(8 * closed) * scene.x0;
    EXPECT_LE((r.x.row(8000).transpose() - expected).cwiseAbs().maxCoeff(), 1e-4) << trial;
  }
}

// All states of sparse dynamics, which are stepped, against those of the same Kronecker sum in modes.
TEST(SteppedStates, EqualThoseInModes) {
  for (const Method method : {Method::march, Method::contour}) {
    const Scene in_modes = make_scene("signorini", {{"Q", 29}});
    Scene sparse = in_modes;
    sparse.dynamics = to_sparse(get<KroneckerDynamics>(in_modes.dynamics));
    Options options = options_for(method, 60);
    options.states = StateSelection::all;
    const auto backend = make_cpu_backend(2);
    const Result expected = solve(in_modes, *backend, options), result = solve(sparse, *backend, options);
    ASSERT_EQ(result.status, Status::solved) << result.reason;
    ASSERT_EQ(result.x.cols(), 29 * 29);
    // Kernels are accepted with errors of 1e-9 of their largest weight, which y of both scenes has.
    const double tolerance = 1e-8 * std::max(1.0, expected.x.cwiseAbs().maxCoeff());
    EXPECT_LE((result.x - expected.x).cwiseAbs().maxCoeff(), tolerance) << to_string(method);
    EXPECT_LE((states_at(sparse, *backend, result, {60, 7, 0}) - result.x({60, 7, 0}, Eigen::all).transpose())
                  .cwiseAbs()
                  .maxCoeff(),
              tolerance);
  }
}

// A rod of finite elements with a mass matrix, heated by columns F, of which one is switched within steps, and held
// from above at its end: 601 states, 1 constraint. With a flow along the rod A is not symmetric.
Scene heated_rod(bool through_B, double flow) {
  constexpr Index m = 601;
  const double d = 1.0 / double(m);
  std::vector<Eigen::Triplet<double>> a, e;
  for (Index i = 0; i < m; ++i) {
    const bool last = i + 1 == m;
    a.emplace_back(i, i, last ? -1 / d : -2 / d);
    e.emplace_back(i, i, last ? d / 3 : 2 * d / 3);
    if (i == 0) continue;
    a.emplace_back(i, i - 1, 1 / d + flow / 2);
    a.emplace_back(i - 1, i, 1 / d - flow / 2);
    for (const auto& [r, c] : {std::pair{i, i - 1}, {i - 1, i}}) e.emplace_back(r, c, d / 6);
  }
  SparseDynamics rod{SparseMatrix(m, m), SparseMatrix(m, 1), SparseMatrix(1, m), SparseMatrix(m, m)};
  rod.A.setFromTriplets(a.begin(), a.end());
  rod.E.setFromTriplets(e.begin(), e.end());
  rod.B.insert(m - 1, 0) = -1;
  rod.N.insert(0, m - 1) = -1;
  Scene scene;
  scene.dynamics = rod;
  scene.M = Matrix{{0.1}};
  scene.x0 = Vector::LinSpaced(m, 0, 0.2);
  scene.T = 0.6;
  scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = 0.3; };
  scene.breakpoints = {0.2345};
  const auto heat = [](double t) { return t < 0.2345 ? 3.0 : -1.0; };
  if (through_B) {
    scene.f_entry = SourceEntry::through_B;
    scene.f = [heat](double t, Eigen::Ref<Vector> f) { f[0] = -heat(t); };
    return scene;
  }
  scene.F = SparseMatrix(m, 2);
  scene.F.insert(m / 2, 0) = 1;
  for (Index i = 0; i < m; ++i) scene.F.insert(i, 1) = d;
  scene.f_entry = SourceEntry::through_F;
  scene.f = [heat](double t, Eigen::Ref<Vector> f) { f << heat(t), std::sin(9 * t); };
  return scene;
}

// Against components in the kernel, which are convolutions with weights of their own.
TEST(SteppedStates, EqualThoseInTheKernel) {
  for (const bool through_B : {false, true})
    for (const double flow : {0, 3}) {
      const Scene scene = heated_rod(through_B, flow);
      Options options = options_for(Method::march, 50);
      options.states = StateSelection::list;
      options.components = {0, 17, 300, 599, 600};
      const Result few = run(scene, options);
      options.states = StateSelection::all;
      options.components.clear();
      const Result all = run(scene, options);
      ASSERT_EQ(all.status, Status::solved) << all.reason;
      EXPECT_GT(all.y.maxCoeff(), 0.1);
      // Weights in a kernel are accepted with an error of 1e-9 of the largest one, those of x0 too.
      EXPECT_LE((all.x(Eigen::all, few.x_components) - few.x).cwiseAbs().maxCoeff(), 1e-8)
          << "through B: " << through_B << ", flow " << flow;
    }
}

TEST(Trace, IsNTimesTheState) {
  const auto backend = make_cpu_backend(1);
  for (const char* name : {"dlcp-small", "bridge"})
    for (const Method method : {Method::contour, Method::contour_literal, Method::march, Method::euler}) {
      const Scene scene = make_scene(name);
      Options options = options_for(method, 64);
      options.states = StateSelection::all;
      options.trace = true;
      options.confirm = false;  // 64 steps are too few for the bridge
      options.tuning.literal_nodes = 64;
      const Result result = solve(scene, *backend, options);
      ASSERT_EQ(result.status, Status::solved) << name << ", " << to_string(method) << ": " << result.reason;
      const DenseDynamics& d = get<DenseDynamics>(scene.dynamics);
      const RowMatrix expected = result.x * d.N.transpose();
      ASSERT_EQ(result.trace.rows(), expected.rows());
      // contour-literal accepts contours that miss N e^{At} B by up to 100 times the printed rate e^{-2.06 sqrt P}/sqrt
      // P, here 9e-9, times t ||N|| ||B||; the other methods are exact up to rounding.
      const double size = d.N.norm() * (scene.x0.norm() + scene.T * d.B.norm() * result.y.cwiseAbs().maxCoeff());
      const double tolerance = (method == Method::contour_literal ? 9e-7 : 1e-11) * size;
      EXPECT_LE((result.trace - expected).cwiseAbs().maxCoeff(), tolerance) << name << ", " << to_string(method);
    }
}

TEST(Trace, OfSignoriniIsTheLineNextToTheMembrane) {
  const Scene scene = make_scene("signorini", {{"Q", 7}});
  const auto backend = make_cpu_backend(1);
  for (const Method method : {Method::contour, Method::march, Method::euler})
    for (const RecurrenceChoice recurrence : {RecurrenceChoice::modal, RecurrenceChoice::compressed}) {
      Options options = options_for(method, 50);
      options.tuning.recurrence = recurrence;
      options.trace = true;
      options.states = StateSelection::list;
      for (Index j = 0; j < 7; ++j) options.components.push_back(7 * j);
      const Result result = solve(scene, *backend, options);
      ASSERT_EQ(result.status, Status::solved) << result.reason;
      // Compressed exponentials represent the kernel to 1e-12 or better.
      EXPECT_LE((result.trace + 2 * result.x).cwiseAbs().maxCoeff(), 1e-10) << to_string(method);
    }
}

TEST(Trace, EndsWhereTheSolutionEndsAndIsEmptyUnasked) {
  const auto backend = make_cpu_backend(1);
  const Scene scene = make_scene("bridge");
  EXPECT_EQ(solve(scene, *backend, options_for(Method::march, 8)).trace.size(), 0);
  Options options = options_for(Method::contour, 400);
  options.trace = true;
  Index polls = 0;
  options.interrupted = [&polls] { return ++polls > 3; };
  const Result result = solve(make_scene("signorini", {{"Q", 15}}), *backend, options);
  ASSERT_EQ(result.status, Status::interrupted);
  ASSERT_EQ(result.trace.rows(), 401);
  for (Index j = 0; j <= 400; ++j) EXPECT_EQ(result.y.row(j).allFinite(), result.trace.row(j).allFinite()) << j;
}

}  // namespace
}  // namespace bromwich
