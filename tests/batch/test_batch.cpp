// Batches against single solves of the same scenes, and against the dense oracle.

#include "core/batch/batch.hpp"

#include "core/catalogue/catalogue.hpp"
#include "core/result/slack.hpp"
#include "core/solve/dense_output.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace bromwich::batch_test {
namespace {

// Both take the same steps in another order of operations: J roundings of a stable recurrence, times the condition of
// M_SS, stay below.
constexpr double same = 1e-12;

RowMatrix around(const Vector& x0, Index scenes, double part, unsigned seed = 1) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  RowMatrix x(scenes, x0.size());
  for (Index k = 0; k < scenes; ++k)
    for (Index i = 0; i < x0.size(); ++i) x(k, i) = x0[i] + part * normal(generator);
  return x;
}

// A stable and coupled, M diagonally dominant: class P.
Scene random_scene(Index m, Index n, unsigned seed) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  const auto draw = [&](Index rows, Index cols) {
    return Matrix(Matrix::NullaryExpr(rows, cols, [&] { return normal(generator); }));
  };
  Scene scene;
  DenseDynamics d{draw(m, m) / std::sqrt(double(m)), draw(m, n), draw(n, m)};
  d.A.diagonal().array() -= 2;
  d.B *= 0.3, d.N *= 0.3;
  scene.dynamics = std::move(d);
  Matrix M = draw(n, n) / double(n);
  M.diagonal().array() += 2 + M.cwiseAbs().rowwise().sum().maxCoeff();
  scene.M = M;
  scene.x0 = draw(m, 1);
  scene.T = 2;
  const Vector a = draw(n, 1), b = draw(m, 1);
  scene.g = [a](double t, Eigen::Ref<Vector> g) { g = a * std::sin(4 * t + 0.3); };
  scene.f = [b](double t, Eigen::Ref<Vector> f) { f = b * std::cos(3 * t); };
  return scene;
}

double apart(const RowMatrix& a, const RowMatrix& b) {
  if (a.rows() != b.rows() || a.cols() != b.cols()) return INFINITY;
  double worst = 0;
  const double size = std::max(1e-300, b.array().isFinite().select(b.array().abs(), 0).maxCoeff());
  for (Index j = 0; j < a.rows(); ++j)
    for (Index i = 0; i < a.cols(); ++i)
      if (std::isnan(a(j, i)) != std::isnan(b(j, i)))
        return INFINITY;
      else if (!std::isnan(a(j, i)))
        worst = std::max(worst, std::abs(a(j, i) - b(j, i)) / size);
  return worst;
}

BatchResult expect_as_single(const Batch& batch, const Options& options, const std::string& what) {
  const auto backend = make_cpu_backend(2);
  const BatchResult found = solve_batch(batch, *backend, options);
  for (Index k = 0; k < batch.scenes; ++k) {
    const Scene scene = scene_of(batch, k);
    const Result one = solve(scene, *backend, options);
    const std::string where = what + ", scene " + std::to_string(k);
    EXPECT_EQ(found.status[std::size_t(k)], one.status) << where << ": " << one.reason;
    EXPECT_EQ(found.reason[std::size_t(k)], one.reason) << where;
    // Scenes side by side are not compared with other steps (docs/batches.md).
    const bool estimated = one.warning.starts_with("with these steps the result is off") ||
                           one.warning.starts_with("y jumps inside steps");
    EXPECT_TRUE(found.warning[std::size_t(k)] == one.warning || (estimated && found.warning[std::size_t(k)].empty()))
        << where << ": '" << found.warning[std::size_t(k)] << "', '" << one.warning << "'";
    EXPECT_EQ(found.method[std::size_t(k)], one.method) << where;
    EXPECT_LE(apart(found.of(found.y, k), one.y), same) << where;
    EXPECT_LE(apart(found.of(found.x, k), one.x), same) << where;
    EXPECT_LE(apart(found.of(found.w, k), slack(scene, one)), same) << where;
    if (std::isnan(one.residual)) {
      EXPECT_TRUE(std::isnan(found.residual[k])) << where;
    } else
      EXPECT_NEAR(found.residual[k], one.residual, same) << where;
  }
  return found;
}

TEST(Batch, ScenesThatShareDynamicsAreSteppedInLanes) {
  for (const auto& [name, part] : {std::pair("dlcp-small", 0.003), {"bridge", 0.3}}) {
    Batch batch;
    batch.common = make_scene(name, {});
    batch.scenes = 19;  // two groups of lanes and a part of one
    batch.x0 = around(batch.common.x0, batch.scenes, part);
    const BatchResult found = expect_as_single(batch, marched(128), name);
    EXPECT_EQ(found.in_lanes, batch.scenes) << name;
  }
}

// A contact in the first step is large beside a state at rest, and small beside the one that it moves.
TEST(Batch, ScenesFromRestAreSteppedInLanes) {
  Batch batch;
  batch.common.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  batch.common.M = Matrix{{1}};
  batch.common.g = [](double t, Eigen::Ref<Vector> g) { g[0] = -std::sin(9 * t); };
  batch.common.x0 = Vector::Zero(1);
  batch.common.T = 1;
  batch.scenes = 5;
  batch.x0 = RowMatrix::Zero(batch.scenes, 1);
  EXPECT_EQ(expect_as_single(batch, marched(1000), "rest").in_lanes, batch.scenes);
}

TEST(Batch, EverySizeOfLanes) {
  for (Index n = 1; n <= 8; ++n) {
    Batch batch;
    batch.common = random_scene(n % 5 + 1, n, unsigned(n));
    batch.scenes = 9;
    batch.x0 = around(batch.common.x0, batch.scenes, 0.5, unsigned(n));
    const BatchResult found = expect_as_single(batch, marched(101), "n = " + std::to_string(n));
    EXPECT_EQ(found.in_lanes, batch.scenes) << n;
  }
}

TEST(Batch, LanesAgreeWithTheDenseOracle) {
  const Index J = 40;
  Batch batch;
  batch.common = random_scene(3, 3, 7);
  batch.scenes = 4;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.5);
  const auto backend = make_cpu_backend(1);
  const BatchResult found = solve_batch(batch, *backend, marched(J));
  ASSERT_EQ(found.in_lanes, batch.scenes);
  for (Index k = 0; k < batch.scenes; ++k) {
    const auto scene = oracle::write_out(scene_of(batch, k));
    const auto run = oracle::march(scene, J);
    ASSERT_EQ(run.infeasible, -1);
    EXPECT_LE(apart(found.of(found.y, k), run.y), 1e-11) << k;  // its weights are sums over all lags
  }
}

TEST(Batch, SourcesThatAreRoughAreTakenInParts) {
  Batch batch;
  batch.common = random_scene(2, 2, 3);
  batch.common.f = [](double t, Eigen::Ref<Vector> f) { f << (t < 0.7313 ? 1 : -1), std::max(std::sin(5 * t), 0.0); };
  batch.common.g = [](double t, Eigen::Ref<Vector> g) { g << (t < 1.1 ? 0.4 : -0.6), std::cos(4 * t); };
  batch.common.breakpoints = {0.7313, 1.1};
  batch.scenes = 9;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.5);
  const BatchResult found = expect_as_single(batch, marched(100), "parts");
  EXPECT_EQ(found.in_lanes, batch.scenes);
}

TEST(Batch, SourcesOfTheirOwn) {
  Batch batch;
  batch.common = random_scene(3, 2, 5);
  batch.scenes = 10;
  for (Index k = 0; k < batch.scenes; ++k) {
    const double a = 1 + 0.1 * double(k);
    batch.f.push_back([a](double t, Eigen::Ref<Vector> f) { f << a * std::sin(t), std::cos(a * t), 0.3; });
    batch.breakpoints.push_back(k == 4 ? std::vector<double>{0.8123} : std::vector<double>{});
    if (k == 4)  // with a jump: solved singly
      batch.g.push_back([](double t, Eigen::Ref<Vector> g) { g << (t < 0.8123 ? 0.4 : -0.4), -0.1; });
    else
      batch.g.push_back([a](double t, Eigen::Ref<Vector> g) { g << std::sin(3 * a * t), -0.2 * a; });
  }
  const BatchResult found = expect_as_single(batch, marched(96), "own sources");
  EXPECT_EQ(found.in_lanes, batch.scenes - 1);
}

TEST(Batch, MatricesOfTheirOwnAndListsOfScenes) {
  Batch batch;
  batch.common = random_scene(3, 2, 6);
  batch.scenes = 3;
  std::vector<Scene> list;
  for (Index k = 0; k < batch.scenes; ++k) {
    const Scene other = random_scene(3, 2, unsigned(20 + k));
    const DenseDynamics d = to_dense(other.dynamics);
    batch.A.push_back(d.A), batch.B.push_back(d.B), batch.N.push_back(d.N);
    batch.M.push_back(std::get<Matrix>(other.M));
    batch.E.push_back(Matrix::Identity(3, 3) * (1 + 0.5 * double(k)));
    list.push_back(other);
    list.push_back(other);
    list.back().x0 *= 0.5;
  }
  expect_as_single(batch, marched(64), "own matrices");
  const BatchResult found = expect_as_single(batch_of(list), marched(64), "list");
  EXPECT_EQ(found.in_lanes, 6);
}

// Four ideal diodes between a resonator and a resistor: M is positive semidefinite, and steps are those of Radau IIA.
Scene diode_bridge() {
  const double C = 1e-6, L = 1e-2, R = 1e3;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, -1 / C}, {1 / L, 0}}, Matrix{{0, 0, -1 / C, 1 / C}, {0, 0, 0, 0}},
                                 Matrix{{0, 0}, {0, 0}, {-1, 0}, {1, 0}}};
  scene.M = Matrix{{1 / R, 1 / R, -1, 0}, {1 / R, 1 / R, 0, -1}, {1, 0, 0, 0}, {0, 1, 0, 0}};
  scene.lcp_class = LcpClass::PSD;
  scene.x0 = Vector{{10, 0}};
  scene.T = 2e-3;
  return scene;
}

// A mass on a spring that drops on a rigid floor: M = 0, y acts on the second derivative of w.
Scene floor_contact() {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {-4, -0.3}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.M = Matrix(Matrix::Zero(1, 1));
  scene.x0 = Vector{{1, 0}};
  scene.f = [](double t, Eigen::Ref<Vector> f) { f << 0, 0.3 * std::sin(5 * t); };
  scene.g = [](double, Eigen::Ref<Vector> g) { g << 0.2; };
  scene.T = 4;
  return scene;
}

// Not definite, of no known class; the problems of the steps are of class P.
Scene of_no_class() {
  Scene scene = random_scene(2, 2, 8);
  scene.M = Matrix{{0.05, -1.2}, {1, 0.02}};
  return scene;
}

TEST(Batch, StagesOfRadauAreSteppedInLanes) {
  for (const auto& [scene, steps, name] : {std::tuple(diode_bridge(), Index(400), "diode bridge"),
                                           {floor_contact(), Index(200), "floor"},
                                           {of_no_class(), Index(64), "no class"}}) {
    Batch batch;
    batch.common = scene;
    batch.scenes = 19;
    batch.x0 = around(scene.x0, batch.scenes, 0.1 * scene.x0.cwiseAbs().maxCoeff());
    const BatchResult found = expect_as_single(batch, marched(steps), name);
    EXPECT_GE(2 * found.in_lanes, batch.scenes) << name;
  }
}

TEST(Batch, StagesWithSourcesOfTheirOwn) {
  Batch batch;
  batch.common = floor_contact();
  batch.scenes = 9;
  for (Index k = 0; k < batch.scenes; ++k) {
    const double a = 0.1 * double(k);
    batch.f.push_back([a](double t, Eigen::Ref<Vector> f) { f << 0, a * std::sin(5 * t); });
    batch.g.push_back([a](double, Eigen::Ref<Vector> g) { g << 0.2 + a; });
  }
  const BatchResult found = expect_as_single(batch, marched(200), "own sources");
  EXPECT_GE(2 * found.in_lanes, batch.scenes);
}

TEST(Batch, MatricesOfTheirOwnInLanes) {
  for (const std::string kind : {"continuous", "without f", "stages"}) {
    const bool stages = kind == "stages";
    Batch batch;
    batch.common = stages ? diode_bridge() : random_scene(3, 4, 6);
    if (kind == "without f") batch.common.f = {};
    batch.scenes = 19;
    const DenseDynamics d = to_dense(batch.common.dynamics);
    const Matrix M = std::get<Matrix>(batch.common.M);
    for (Index k = 0; k < batch.scenes; ++k) {
      const double by = 1 + 0.03 * double(k);
      batch.A.push_back(by * d.A), batch.B.push_back(d.B / by), batch.N.push_back(d.N);
      batch.M.push_back(stages ? M : Matrix(M * by));
    }
    batch.x0 = around(batch.common.x0, batch.scenes, 0.02 * batch.common.x0.cwiseAbs().maxCoeff());
    const BatchResult found = expect_as_single(batch, marched(300), kind);
    EXPECT_GE(2 * found.in_lanes, batch.scenes);
  }
}

// An oscillation that 24 steps do not resolve: a single solve refuses it, and so does the batch.
TEST(Batch, WhatASingleSolveDoubtsIsNotCalledSolved) {
  Batch batch;
  batch.common = make_scene("bridge", {});
  batch.scenes = 9;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.5);
  for (const Index steps : {5, 12, 24, 48}) expect_as_single(batch, marched(steps), std::to_string(steps) + " steps");
}

TEST(Batch, OneSceneThatFailsSpoilsNothing) {
  Batch batch;
  batch.common = make_scene("dlcp-small", {});
  batch.scenes = 12;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.003);
  const Options options = marched(64);
  const auto backend = make_cpu_backend(2);
  const BatchResult all = solve_batch(batch, *backend, options);
  batch.x0.row(3) << 5, 5, 5;  // the constraints have no solution at t = 0
  batch.x0(7, 1) = std::numeric_limits<double>::quiet_NaN();
  const BatchResult found = solve_batch(batch, *backend, options);
  EXPECT_EQ(found.status[3], solve(scene_of(batch, 3), *backend, options).status);
  EXPECT_NE(found.status[3], Status::solved);
  EXPECT_EQ(found.status[7], Status::unsupported);
  EXPECT_EQ(found.reason[7].rfind("x0: entry", 0), 0u) << found.reason[7];
  EXPECT_TRUE(found.of(found.y, 7).array().isNaN().all());
  EXPECT_EQ(found.solved(), 10);
  for (const Index k : {0, 1, 2, 4, 5, 6, 8, 9, 10, 11})
    EXPECT_EQ(apart(found.of(found.y, k), all.of(all.y, k)), 0) << k;  // the lanes do not mix
}

TEST(Batch, BlocksAreTheWhole) {
  Batch batch;
  batch.common = random_scene(2, 2, 9);
  batch.scenes = 50;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.5);
  Options options = marched(64);
  const auto backend = make_cpu_backend(1);
  const BatchResult whole = solve_batch(batch, *backend, options);
  options.memory_limit = predicted_bytes(batch, options, 20);
  EXPECT_EQ(refusal([&] { solve_batch(batch, *backend, options); }).rfind("memory_limit: 50 scenes are predicted", 0),
            0u);
  Index next = 0, reported = 0;
  options.progress = [&](const Progress& p) {
    EXPECT_GE(p.iteration, reported);
    EXPECT_EQ(p.total, 50);
    reported = p.iteration;
  };
  const Index blocks = solve_in_blocks(batch, *backend, options, [&](Index first, const BatchResult& block) {
    ASSERT_EQ(first, next);
    next += block.scenes;
    EXPECT_LE(apart(block.y, whole.y.middleRows(first * whole.rows(), block.scenes * whole.rows())), same);
  });
  EXPECT_EQ(blocks, 3);
  EXPECT_EQ(next, 50);
  EXPECT_EQ(reported, 50);
}

TEST(Batch, Interrupted) {
  Batch batch;
  batch.common = random_scene(2, 2, 9);
  batch.scenes = 400;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.5);
  Options options = marched(16);
  options.interrupted = [] { return true; };
  const auto backend = make_cpu_backend(1);
  const BatchResult found = solve_batch(batch, *backend, options);
  EXPECT_GT(found.solved(), 0);
  EXPECT_EQ(found.status.back(), Status::interrupted);
  EXPECT_TRUE(found.of(found.y, 399).array().isNaN().all());
}

TEST(Batch, RowsAtGivenTimes) {
  Batch batch;
  batch.common = random_scene(3, 2, 5);
  batch.scenes = 3;
  batch.x0 = around(batch.common.x0, batch.scenes, 0.5);
  batch.times = {0, 0.313, 2};
  const auto backend = make_cpu_backend(1);
  for (const double tolerance : {0.0, 1e-4}) {
    Options options = marched(tolerance > 0 ? 0 : 64);
    options.tolerance = tolerance;
    const BatchResult found = solve_batch(batch, *backend, options);
    ASSERT_EQ(found.rows(), 3);
    for (Index k = 0; k < batch.scenes; ++k) {
      const Scene scene = scene_of(batch, k);
      const Result one = at_times(scene, *backend, solve(scene, *backend, options), batch.times);
      EXPECT_EQ(found.status[std::size_t(k)], Status::solved);
      EXPECT_LE(apart(found.of(found.y, k), one.y), same);
      EXPECT_LE(apart(found.of(found.x, k), one.x), same);
      EXPECT_LE(apart(found.of(found.w, k), slack(scene, one)), same);
    }
  }
}

TEST(Batch, BadInputIsRefused) {
  const auto backend = make_cpu_backend(1);
  Batch batch;
  batch.common = random_scene(2, 2, 9);
  batch.scenes = 3;
  const auto said = [&](const Batch& b, const Options& options = {}) {
    return refusal([&] { solve_batch(b, *backend, options); });
  };
  Batch b = batch;
  b.x0 = RowMatrix::Zero(2, 2);
  EXPECT_EQ(said(b), "x0: is 2 x 2; make it scenes x states = 3 x 2");
  b = batch;
  b.M.assign(2, Matrix::Identity(2, 2));
  EXPECT_EQ(said(b), "M: has 2 entries; give 3, one per scene, or none");
  b.M.assign(3, Matrix::Identity(3, 3));
  EXPECT_EQ(said(b), "M of scene 0: is 3 x 3; make it the shape that all scenes have = 2 x 2");
  b = batch;
  b.scenes = 0;
  EXPECT_EQ(said(b), "scenes: is 0; give at least one scene");
  EXPECT_EQ(said(batch_of({random_scene(2, 2, 1), random_scene(3, 2, 1)})),
            "states: is 3 in scene 1; give 2 as in scene 0: all have one structure");
  Options options;
  options.tolerance = 1e-4;
  EXPECT_EQ(said(batch, options),
            "tolerance: is given to a batch without times; give times, at which all scenes have rows");
  b = batch;
  b.times = {0, 3};
  EXPECT_EQ(said(b), "times: has 3 at 1; give times in order, from 0 to T = 2");
  options = {};
  options.states = StateSelection::list;
  options.components = {2};
  EXPECT_EQ(said(batch, options), "states: component 2 of 2; components are counted from 0");
  b = batch;
  b.common.M = Matrix(Matrix::Identity(3, 3));
  EXPECT_EQ(said(b).rfind("M: is 3 x 3", 0), 0u);
}

}  // namespace
}  // namespace bromwich::batch_test
