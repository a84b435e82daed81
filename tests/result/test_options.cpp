// What a solve reaches that names neither steps nor a tolerance.

#include "batch/batch.hpp"
#include "core/base/error.hpp"
#include "core/solve/solver.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

constexpr double frequency = 300, amplitude = 100;

// x' = -x + F cos(w t), y = 0 since w stays positive. 400 steps have w h = 0.75: f as a line between them errs by
// (w h)^2/12 = 5 %.
Scene fast_source() {
  Scene scene;
  scene.dynamics = DenseDynamics{.A = Matrix{{-1}}, .B = Matrix{{1}}, .N = Matrix{{1}}, .E = {}};
  scene.M = Matrix{{1}};
  scene.x0 = Vector::Zero(1);
  scene.f = [](double t, Eigen::Ref<Vector> f) { f[0] = amplitude * std::cos(frequency * t); };
  scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = 10; };
  return scene;
}

double exact(double t) {
  return amplitude / (1 + frequency * frequency) *
         (std::cos(frequency * t) + frequency * std::sin(frequency * t) - std::exp(-t));
}

// Relative to the largest value, amplitude / frequency.
template <class Rows>
double error_of(const Vector& t, const Rows& x) {
  double largest = 0;
  for (Index j = 0; j < t.size(); ++j) largest = std::max(largest, std::abs(x(j, 0) - exact(t[j])));
  return largest * frequency / amplitude;
}

Options with_states() {
  Options options;
  options.states = StateSelection::all;
  return options;
}

TEST(Defaults, AreAToleranceOfAThousandth) {
  const auto backend = make_cpu_backend(1);
  const Result r = solve(fast_source(), *backend, with_states());
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_TRUE(r.error_estimate);
  EXPECT_LE(*r.error_estimate, 1e-3);
  EXPECT_LE(error_of(r.t, r.x), 1e-3);
  Solver solver(fast_source(), *backend, with_states());
  const Result prepared = solver.solve();
  EXPECT_LE(error_of(prepared.t, prepared.x), 1e-3);
}

TEST(Defaults, AreTheStepsOrTheToleranceOfTheScene) {
  Scene scene = fast_source();
  scene.default_steps = 2000;
  EXPECT_EQ(solve(scene, *make_cpu_backend(1), with_states()).steps, 2000);
  scene.default_tolerance = 1e-5;
  const Result r = solve(scene, *make_cpu_backend(1), with_states());
  EXPECT_LE(error_of(r.t, r.x), 1e-5);
  scene.default_tolerance = 1;
  EXPECT_THROW(scene.validate(), Error);
}

TEST(Defaults, LeaveWhatIsNamedAndWhatGoesWithStepsAlone) {
  const Scene scene = fast_source();
  const auto tolerance = [&](auto change) {
    Options options;
    change(options);
    return with_defaults(options, scene).tolerance;
  };
  EXPECT_EQ(tolerance([](Options&) {}), 1e-3);
  EXPECT_EQ(tolerance([](Options& o) { o.steps = 50; }), 0);
  EXPECT_EQ(tolerance([](Options& o) { o.tolerance_x = 1e-6; }), 0);
  EXPECT_EQ(tolerance([](Options& o) { o.absolute_tolerance = 1e-6; }), 0);
  EXPECT_EQ(tolerance([](Options& o) { o.confirm = false; }), 0);
  EXPECT_EQ(tolerance([](Options& o) { o.event_location = true; }), 0);
  EXPECT_EQ(tolerance([](Options& o) { o.method = Method::goal; }), 0);
}

// Rows of a batch are those of one grid, but at times of one's own each scene may have another one.
TEST(Defaults, OfBatchesAreAToleranceAtTimesOfOnesOwn) {
  const auto backend = make_cpu_backend(1);
  Batch batch;
  batch.common = fast_source();
  batch.scenes = 2;
  batch.x0 = RowMatrix::Zero(2, 1);
  EXPECT_EQ(solve_batch(batch, *backend, with_states()).t.size(), 401);
  batch.times = {0, 0.3, 0.7, 1};
  const BatchResult r = solve_batch(batch, *backend, with_states());
  for (Index k = 0; k < 2; ++k) EXPECT_LE(error_of(r.t, r.of(r.x, k)), 1e-3) << k;
}

}  // namespace
}  // namespace bromwich
