// Contract of many scenes side by side on every backend (core/seam/scene_march.hpp where it has that, lanes of vectors
// elsewhere): against the dense oracle, and status by status against single solves on the CPU.

#include "batch/batch.hpp"
#include "batch/batch_arrays.hpp"
#include "catalogue/catalogue.hpp"
#include "core/solve/solve.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/batches.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/run.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace bromwich {
namespace {

using reference::Random;

constexpr Index scenes = 70;  // above two warps, and no multiple of the lanes of a vector
// J roundings of a stable recurrence, in another order of operations, times the condition of the problems.
constexpr double same = 1e-12;

Batch around(const Scene& scene, double part) {
  Random random(7);
  Batch batch;
  batch.common = scene;
  batch.scenes = scenes;
  batch.x0 = RowMatrix(random.matrix(scenes, scene.states())) * part;
  batch.x0.rowwise() += scene.x0.transpose();
  return batch;
}

// M = P P^T + I, A stable.
Scene drawn(Index m, Index n, unsigned seed) {
  Random random(seed);
  Scene scene;
  DenseDynamics d{random.matrix(m, m), random.matrix(m, n), random.matrix(n, m)};
  d.A -= 2 * std::sqrt(double(m)) * Matrix::Identity(m, m);
  scene.dynamics = d;
  const Matrix P = random.matrix(n, n);
  scene.M = Matrix(P * P.transpose() + Matrix::Identity(n, n));
  scene.x0 = random.vector(m);
  scene.T = 3;
  scene.f = [m](double t, Eigen::Ref<Vector> f) {
    for (Index i = 0; i < m; ++i) f[i] = std::cos(2 * t + double(i));
  };
  scene.g = [n](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < n; ++i) g[i] = std::sin(3 * t + double(i));
  };
  return scene;
}

double apart(const RowMatrix& a, const RowMatrix& b) {
  if (a.rows() != b.rows() || a.cols() != b.cols()) return INFINITY;
  if (!(a.array().isNaN() == b.array().isNaN()).all()) return INFINITY;
  const RowMatrix of = b.array().isNaN().select(0, b), error = b.array().isNaN().select(0, a - b);
  return error.cwiseAbs().maxCoeff() / std::max(1e-300, of.cwiseAbs().maxCoeff());
}

using BackendScenes = BackendTest;

Index expect_as_single(const Batch& batch, Backend& backend, Index steps, const std::string& what) {
  const Options options = marched(steps);
  const auto cpu = make_cpu_backend(1);
  const BatchResult found = solve_batch(batch, backend, options);
  for (Index k = 0; k < batch.scenes; k += 3) {
    const std::string where = what + ", scene " + std::to_string(k);
    try {
      const Result one = solve(scene_of(batch, k), *cpu, options);
      EXPECT_EQ(found.status[std::size_t(k)], one.status) << where << ": " << one.reason;
      EXPECT_EQ(found.warning[std::size_t(k)], one.warning) << where;
      EXPECT_LE(apart(found.of(found.y, k), one.y), same) << where;
      EXPECT_LE(apart(found.of(found.x, k), one.x), same) << where;
      if (!std::isnan(one.residual)) {
        EXPECT_NEAR(found.residual[k], one.residual, same) << where;
      }
    } catch (const Error&) {
      EXPECT_EQ(found.status[std::size_t(k)], Status::unsupported) << where;
    }
  }
  return found.in_lanes;
}

TEST_P(BackendScenes, AreSteppedAsTheyAreAlone) {
  for (const auto& [m, n] : {std::pair<Index, Index>(1, 1), {3, 2}, {4, 4}, {5, 3}, {8, 8}})
    EXPECT_GE(2 * expect_as_single(around(drawn(m, n, unsigned(m)), 0.5), *backend, 100, "drawn"), scenes)
        << m << " " << n;
  EXPECT_EQ(expect_as_single(around(make_scene("dlcp-small", {}), 0.003), *backend, 128, "dlcp-small"), scenes);
  Scene bridge = batch_test::diode_bridge();
  bridge.T = 1e-3;
  EXPECT_GE(2 * expect_as_single(around(bridge, 0.3), *backend, 200, "diode bridge"), scenes);
}

// A, B, N and M of each scene differ from those of `scene` by up to `part` of each entry.
Batch with_own_matrices(const Scene& scene, double part) {
  Random random(11);
  Batch batch = around(scene, 0.1);
  const DenseDynamics& d = *scene.dynamics->small_state();
  const auto other = [&](const Matrix& of) {
    return Matrix(of.array() * (1 + part * random.matrix(of.rows(), of.cols()).array()));
  };
  for (Index k = 0; k < scenes; ++k) {
    batch.A.push_back(other(d.A)), batch.B.push_back(other(d.B)), batch.N.push_back(other(d.N));
    const Matrix M = to_dense(scene.M), off = other(M);
    batch.M.push_back(M.isZero(0) || part == 0 ? M : Matrix((off + off.transpose()) / 2));
  }
  return batch;
}

TEST_P(BackendScenes, HaveMatricesOfTheirOwn) {
  for (const auto& [m, n] : {std::pair<Index, Index>(1, 1), {3, 2}, {4, 4}, {5, 3}, {8, 8}})
    EXPECT_GE(2 * expect_as_single(with_own_matrices(drawn(m, n, unsigned(m)), 0.1), *backend, 100, "drawn"), scenes)
        << m << " " << n;
  Scene through_B = drawn(4, 2, 9);
  through_B.f_entry = SourceEntry::through_B;
  through_B.f = [](double t, Eigen::Ref<Vector> f) { f << std::cos(2 * t), t; };
  EXPECT_GE(2 * expect_as_single(with_own_matrices(through_B, 0.1), *backend, 100, "f through B"), scenes);
}

// Steps in stages are taken in the natural units of each scene, which differ.
TEST_P(BackendScenes, HaveMatricesAndUnitsOfTheirOwn) {
  Scene bridge = batch_test::diode_bridge();
  bridge.T = 1e-3;
  Batch batch = around(bridge, 0.3);
  Random random(12);
  const DenseDynamics& d = *bridge.dynamics->small_state();
  for (Index k = 0; k < scenes; ++k) batch.A.push_back(d.A * (1 + 0.3 * random.matrix(1, 1)(0, 0)));
  for (Index k = 0; k < scenes; ++k) batch.x0.row(k) *= std::pow(10.0, double(k % 5) - 2);
  EXPECT_GE(2 * expect_as_single(batch, *backend, 200, "diode bridge"), scenes);
  batch.common.f = [](double t, Eigen::Ref<Vector> f) { f << 0, 300 * std::sin(2e4 * t); };
  EXPECT_GE(2 * expect_as_single(batch, *backend, 200, "diode bridge with a source"), scenes);
}

TEST_P(BackendScenes, GiveRowsAtTimePointsOfTheGrid) {
  const Index J = 100;
  Options options = marched(J);
  options.trace = true;
  for (Batch batch : {around(drawn(3, 2, 4), 0.5), with_own_matrices(drawn(3, 2, 4), 0.1)}) {
    const BatchResult all = solve_batch(batch, *backend, options);
    batch.times = {0, 0.29 * batch.common.T, batch.common.T};
    const BatchResult some = solve_batch(batch, *backend, options);
    EXPECT_EQ(some.in_lanes, all.in_lanes);
    for (Index k = 0; k < scenes; ++k)
      for (const auto& [of_some, of_all] : {std::pair(&some.y, &all.y), {&some.x, &all.x}, {&some.w, &all.w}}) {
        const RowMatrix rows = all.of(*of_all, k)(std::vector<Index>{0, 29, J}, Eigen::all);
        EXPECT_LE((some.of(*of_some, k) - rows).cwiseAbs().maxCoeff(), 16 * epsilon) << k;  // terms of w are below 2
      }
    batch.times = {0.123 * batch.common.T};  // not on the grid: by single solves
    EXPECT_EQ(solve_batch(batch, *backend, options).in_lanes, 0);
  }
}

// On a backend with memory of its own, also the rows of scenes that it has not settled.
TEST_P(BackendScenes, LeaveTheirRowsOnTheBackend) {
  Batch batch = with_own_matrices(drawn(3, 2, 4), 0.1);
  batch.x0(7, 0) = std::numeric_limits<double>::quiet_NaN();
  const BatchResult expected = solve_batch(batch, *backend, marched(100));
  batch.keep_on_backend = true;
  const BatchResult found = solve_batch(batch, *backend, marched(100));
  EXPECT_EQ(found.status, expected.status);
  EXPECT_EQ(bool(found.arrays), bool(backend->fused().slabs));
  RowMatrix y = found.y, x = found.x;
  if (found.arrays) backend->download(found.arrays->y(), y), backend->download(*found.arrays->x(), x);
  EXPECT_EQ(apart(y, expected.y), 0);
  EXPECT_EQ(apart(x, expected.x), 0);
}

TEST_P(BackendScenes, AgreeWithTheDenseOracle) {
  const Index J = 40;
  const Batch batch = around(drawn(3, 3, 5), 0.5);
  const BatchResult found = solve_batch(batch, *backend, marched(J));
  for (Index k = 0; k < scenes; k += 10) {
    const auto run = oracle::march(oracle::write_out(scene_of(batch, k)), J);
    ASSERT_EQ(run.infeasible, -1);
    EXPECT_LE(apart(found.of(found.y, k), run.y), 1e-11) << k;  // its weights are sums over all lags
  }
}

TEST_P(BackendScenes, SpoilNothingWhereOneFails) {
  Batch batch = around(make_scene("dlcp-small", {}), 0.003);
  batch.x0.row(3) << 5, 5, 5;  // the constraints have no solution at t = 0
  batch.x0(33, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(expect_as_single(batch, *backend, 64, "with failures"), scenes - 2);
}

INSTANTIATE_TEST_SUITE_P(Contract, BackendScenes, testing::ValuesIn(backend_cases()), backend_case_name);

}  // namespace
}  // namespace bromwich
