// Derivatives of batches: those of single scenes, central differences of batches, one scene that fails.

#include "batch/batch_derivative.hpp"

#include "core/base/error.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich::batch_derivative_test {
namespace {

using reference::Random;

constexpr Index K = 13, J = 50, m = 3, n = 2;

Batch drawn() {
  Random random(90);
  Batch batch;
  batch.scenes = K;
  Scene& s = batch.common;
  const Matrix P = random.matrix(n, n);
  s.dynamics = DenseDynamics{random.matrix(m, m) - Matrix::Identity(m, m), random.matrix(m, n), random.matrix(n, m)};
  s.M = Matrix(P * P.transpose() + Matrix::Identity(n, n));
  s.g = [](double t, Eigen::Ref<Vector> g) { g << std::sin(2.3 * t + 0.4), std::sin(1.9 * t + 2); };
  s.x0 = Vector::Zero(m);
  s.T = 3;
  batch.x0 = random.matrix(K, m);
  for (Index k = 0; k < K; ++k) batch.M.push_back(to_dense(s.M) + 0.05 * double(k) * Matrix::Identity(n, n));
  return batch;
}

BatchResult solved(const Batch& batch, Index steps = J) {
  Options options;
  options.steps = steps;
  options.method = Method::march;
  return solve_batch(batch, *make_cpu_backend(1), options);
}

std::vector<DataChange> changes(unsigned seed) {
  Random random(seed);
  std::vector<DataChange> all;
  for (Index k = 0; k < K; ++k) {
    DataChange c;
    c.x0 = random.vector(m), c.M = random.matrix(n, n), c.A = random.matrix(m, m), c.g = random.matrix(J + 1, n);
    all.push_back(c);
  }
  return all;
}

TEST(BatchDerivative, IsThatOfEachScene) {
  const Batch batch = drawn();
  const BatchDerivative d(batch, solved(batch));
  const std::vector<DataChange> given = changes(1);
  const auto backend = make_cpu_backend(2);
  const PerScene<SolutionChange> out = d.jvp(given, *backend);
  Random random(2);
  std::vector<SolutionChange> of;
  for (Index k = 0; k < K; ++k)
    of.push_back({random.matrix(J + 1, n), random.matrix(J + 1, m), {}, random.matrix(J + 1, n)});
  const PerScene<DataChange> bar = d.vjp(of, *backend);
  Options options;
  options.steps = J;
  options.method = Method::march;
  for (Index k = 0; k < K; ++k) {
    ASSERT_EQ(d.reason()[std::size_t(k)], "");
    const Scene scene = scene_of(batch, k);
    const SolutionDerivative one(scene, solve(scene, *backend, options));
    const SolutionChange alone = one.jvp(given[std::size_t(k)]), &here = out.value[std::size_t(k)];
    // y of a batch and of a single solve differ by rounding, and so do derivatives along them.
    EXPECT_LE((here.y - alone.y).norm(), 1e-10 * alone.y.norm()) << k;
    EXPECT_LE((here.x - alone.x).norm(), 1e-10 * alone.x.norm()) << k;
    EXPECT_NEAR(d.margin()[std::size_t(k)].margin, one.margin().margin, 1e-9);
    const auto dot = [](const auto& a, const auto& b) { return a.cwiseProduct(b).sum(); };
    const DataChange &u = bar.value[std::size_t(k)], &c = given[std::size_t(k)];
    const SolutionChange& l = of[std::size_t(k)];
    const double forward = dot(l.y, here.y) + dot(l.x, here.x) + dot(l.integral, here.integral);
    const double backward = u.x0.dot(c.x0) + dot(u.M, c.M) + dot(u.A, c.A) + dot(u.g, c.g);
    EXPECT_LE(std::abs(forward - backward), 1e-12 * (l.y.norm() + l.x.norm() + l.integral.norm()) *
                                                (here.y.norm() + here.x.norm() + here.integral.norm()))
        << k;
  }
}

// One change for all scenes: x0 of every scene moves by the same vector.
TEST(BatchDerivative, AgreesWithDifferencesOfBatches) {
  const Batch batch = drawn();
  const BatchDerivative d(batch, solved(batch));
  DataChange c;
  c.x0 = Vector{{0.3, -1, 0.5}};
  const PerScene<SolutionChange> out = d.jvp({c});
  double least = 1;
  for (const DerivativeMargin& at : d.margin()) least = std::min(least, at.margin);
  ASSERT_GT(least, 1e-6);
  const double step = 0.05 * least;
  Batch up = batch, down = batch;
  up.x0.rowwise() += step * c.x0.transpose();
  down.x0.rowwise() -= step * c.x0.transpose();
  const BatchResult a = solved(up), b = solved(down);
  const RowMatrix y = (a.y - b.y) / (2 * step);  // linear where the sets stay: rounding over the step is left
  for (Index k = 0; k < K; ++k) {
    const RowMatrix rows = y.middleRows(k * (J + 1), J + 1);
    EXPECT_LE((out.value[std::size_t(k)].y - rows).cwiseAbs().maxCoeff(),
              1e-6 * rows.cwiseAbs().maxCoeff() + 1e-14 / step);
  }
}

TEST(BatchDerivative, AFailedSceneSpoilsNothing) {
  Batch batch = drawn();
  batch.x0(4, 1) = std::nan("");
  const BatchResult result = solved(batch);
  const BatchDerivative d(batch, result);
  DataChange c;
  c.x0 = Vector::Ones(m);
  const PerScene<SolutionChange> out = d.jvp({c});
  for (Index k = 0; k < K; ++k) {
    EXPECT_EQ(out.reason[std::size_t(k)].empty(), k != 4) << k;
    EXPECT_EQ(out.value[std::size_t(k)].y.allFinite(), k != 4) << k;
  }
  EXPECT_NE(d.reason()[4].find("not solved"), std::string::npos) << d.reason()[4];
  EXPECT_THROW(d.jvp({c, c}), Error) << "neither one nor K changes";
  c.x0 = Vector::Ones(m + 1);
  EXPECT_THROW(d.jvp({c}), Error);
  EXPECT_THROW(BatchDerivative(batch, BatchResult{}), Error);
  batch.times = {0, 1, 3};
  EXPECT_THROW(BatchDerivative(batch, result, false), Error);
}

// x' = 2 - sgn x in a batch: dx(T)/dx0 = 1/3 where x crosses 0, and 1 where it starts above.
TEST(BatchDerivative, LocatesSwitchesWhereYJumps) {
  Batch batch;
  batch.scenes = 2;
  Scene& s = batch.common;
  s.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{-2, 0}}, Matrix{{-1}, {0}}};
  s.M = Matrix{{0, 1}, {-1, 0}};
  s.f = [](double, Eigen::Ref<Vector> v) { v[0] = 3; };
  s.g = [](double, Eigen::Ref<Vector> v) { v << 0, 1; };
  s.x0 = Vector{{0}};
  s.T = 1;
  batch.x0 = RowMatrix{{-0.95}, {0.5}};
  const BatchDerivative d(batch, solved(batch));
  DataChange c;
  c.x0 = Vector{{1}};
  const PerScene<SolutionChange> out = d.jvp({c});
  ASSERT_EQ(out.reason[0] + out.reason[1], "");
  EXPECT_TRUE(d.located()[0] && d.located()[1]);
  EXPECT_NEAR(out.value[0].x(J, 0), 1.0 / 3, 1e-9);
  EXPECT_NEAR(out.value[1].x(J, 0), 1, 1e-9);
}

}  // namespace
}  // namespace bromwich::batch_derivative_test
