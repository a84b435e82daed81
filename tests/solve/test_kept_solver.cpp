// A KeptSolver against fresh solves.

#include "core/solve/kept_solver.hpp"

#include "core/base/error.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"
#include "tests/solve/solver_cases.hpp"

#include <gtest/gtest.h>

#include <memory>
#include <stdexcept>
#include <vector>

namespace bromwich::solver_test {
namespace {

Options options_of(const SolverCase& c) {
  Options options;
  options.method = c.method;
  options.steps = c.steps;
  options.tolerance = c.tolerance;
  return options;
}

std::vector<SolverCase> cases() {
  const Scene kronecker = make_scene("signorini", {{"Q", 60}}), sparse = sparse_signorini();
  std::vector<SolverCase> all;
  for (const Method m : {Method::march, Method::contour, Method::multigrid, Method::euler, Method::automatic}) {
    all.push_back({"signorini", kronecker, m});
    all.push_back({"sparse", sparse, m});
  }
  all.push_back({"signorini to a tolerance", kronecker, Method::automatic, 32, 1e-2});
  all.push_back({"dense", make_scene("dlcp-small"), Method::automatic});
  all.push_back({"boundary values", make_scene("bridge"), Method::galerkin, 50});
  return all;
}

// Other x0, f and g by a factor of `size`: with 1e4 the natural units change, too.
Scene changed(const Scene& scene, double size) {
  Scene other = scene;
  other.exact = {};
  if (scene.x0.size() > 0) other.x0 = size * (scene.x0 + Vector::Constant(scene.states(), 0.01));
  other.f = times(size, scene.f);
  other.g = times(size, scene.g);
  return other;
}

void expect_fresh_solves(Backend& backend) {
  KeptSolver kept(backend);
  for (const SolverCase& c : cases()) {
    const std::string what = c.name + " " + to_string(c.method) + " on " + backend.name();
    const Options options = options_of(c);
    const Result fresh = solve(c.scene, backend, options);
    for (int repeat = 0; repeat < 2; ++repeat) {
      const Result again = kept.solve(c.scene, options);
      expect_same(again, fresh, what);
      EXPECT_EQ(again.status, fresh.status) << what;
      EXPECT_EQ(again.steps, fresh.steps) << what;
    }
    for (const double size : {0.5, 1e4}) {
      const Scene other = changed(c.scene, size);
      const Result expected = solve(other, backend, options);
      expect_same(kept.solve(other, options), expected, what + " with other sources");
    }
  }
}

TEST(KeptSolver, HasTheResultsOfFreshSolves) { expect_fresh_solves(*make_cpu_backend(1)); }

TEST(KeptSolver, HasTheResultsOfFreshSolvesOnADevice) {
  if (cuda_devices().empty()) GTEST_SKIP() << "no CUDA device";
  expect_fresh_solves(*make_cuda_backend(make_cpu_backend(1)));
}

TEST(KeptSolver, CallsTheFunctionsOfEachSolve) {
  const auto backend = make_cpu_backend(1);
  KeptSolver kept(*backend);
  Scene scene = make_scene("signorini", {{"Q", 60}});
  int calls = 0;
  Options options;
  options.method = Method::contour;
  options.steps = 64;
  options.log = [&](const LogEntry&) { ++calls; };
  const Result first = kept.solve(scene, options);
  EXPECT_GT(calls, 0);
  int others = 0;
  options.log = [&](const LogEntry&) { ++others; };
  const int before = calls;
  kept.solve(scene, options);
  EXPECT_EQ(calls, before);  // functions of the first call are not used again
  EXPECT_GT(others, 0);
}

TEST(KeptSolver, OtherOptionsAndScenesAreSolvedAnew) {
  const auto backend = make_cpu_backend(1);
  KeptSolver kept(*backend);
  const Scene scene = make_scene("signorini", {{"Q", 60}});
  Options options;
  options.method = Method::contour;
  options.steps = 64;
  kept.solve(scene, options);
  options.steps = 128;
  expect_same(kept.solve(scene, options), solve(scene, *backend, options), "scene");
  options.states = StateSelection::all;
  expect_same(kept.solve(scene, options), solve(scene, *backend, options), "scene");
  Scene longer = scene;
  longer.T = 2 * scene.T;
  expect_same(kept.solve(longer, options), solve(longer, *backend, options), "longer");
  Scene stiffer = scene;
  get<KroneckerDynamics>(stiffer.dynamics).across.diffusivity *= 2;
  expect_same(kept.solve(stiffer, options), solve(stiffer, *backend, options), "stiffer");
}

TEST(KeptSolver, AnExceptionLeavesNothingHalfDone) {
  const auto backend = make_cpu_backend(1);
  KeptSolver kept(*backend);
  const Scene scene = make_scene("signorini", {{"Q", 60}});
  Options options;
  options.method = Method::contour;
  options.steps = 64;
  kept.solve(scene, options);
  Scene fails = scene;
  fails.g = [g = scene.g](double t, Eigen::Ref<Vector> v) {
    if (t > 0.5) throw std::runtime_error("no value");
    g(t, v);
  };
  EXPECT_THROW(kept.solve(fails, options), std::runtime_error);
  expect_same(kept.solve(scene, options), solve(scene, *backend, options), "scene");
}

}  // namespace
}  // namespace bromwich::solver_test
