// What the grids of a tolerance share in a Solver, and what it keeps of them.

#include "core/result/located.hpp"
#include "core/solve/solver.hpp"

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"
#include "tests/solve/solver_cases.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>
#include <Eigen/SparseLU>

#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>

namespace bromwich::solver_test {
namespace {

// Dense and stiff: A is not symmetric, and so large that h |A| > 1 on all grids that are used.
Scene dense_scene() {
  const Index m = 24, n = 2;
  Matrix A = -150 * Matrix::Identity(m, m);
  for (Index i = 0; i < m; ++i)
    for (Index j = 0; j < m; ++j) A(i, j) += 20 * std::sin(double(1 + 3 * i + 5 * i * j + 7 * j * j));
  Scene scene;
  scene.dynamics = DenseDynamics{A, Matrix::Identity(m, n), Matrix::Identity(n, m)};
  scene.M = Matrix(2 * Matrix::Identity(n, n));
  scene.x0 = Vector::Constant(m, 0.2);
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << std::cos(2 * t) - 0.5, std::sin(3 * t); };
  scene.T = 2;
  scene.default_steps = 64;
  return scene;
}

std::vector<SolverCase> tolerance_cases() {
  std::vector<SolverCase> all{{"dense", dense_scene(), Method::march, 0, 1e-4},
                              {"signorini", make_scene("signorini", {{"Q", 60}}), Method::march, 0, 1e-3},
                              {"signorini", make_scene("signorini", {{"Q", 60}}), Method::multigrid, 0, 1e-2},
                              {"sparse", sparse_signorini(), Method::march, 0, 1e-2},
                              {"bridge", make_scene("bridge"), Method::galerkin, 0, 1e-3}};
  for (SolverCase& c : all) c.scene.exact = {};
  Scene free = dense_scene();
  free.free_rows = {1};
  all.push_back({"free rows", free, Method::march, 0, 1e-3});
  Scene mass = dense_scene();
  mass.dynamics = [d = get<DenseDynamics>(mass.dynamics)]() mutable {
    d.E = Vector::LinSpaced(d.A.rows(), 1, 3).asDiagonal();
    return Dynamics(d);
  }();
  all.push_back({"mass", mass, Method::march, 0, 1e-3});
  return all;
}

// The sum of what each grid makes on its own.
PreparationCounts made_alone(const SolverCase& c, Backend& backend, const std::vector<Index>& grids) {
  PreparationCounts sum;
  for (const Index J : grids) {
    Options options;
    options.method = c.method;
    options.steps = J;
    Solver one(c.scene, backend, options);
    one.solve();
    const PreparationCounts made = one.made();
    sum.exponentials += made.exponentials;
    sum.fits += made.fits;
    sum.shifted_solves += made.shifted_solves;
    sum.spectra += made.spectra;
    sum.classifications += made.classifications;
  }
  return sum;
}

TEST(Solver, GridsOfAToleranceShareWhatTheyCan) {
  const auto backend = make_cpu_backend(2);
  for (const SolverCase& c : tolerance_cases()) {
    const std::string what = c.name + " " + to_string(c.method);
    Options options;
    options.method = c.method;
    options.tolerance = c.tolerance;
    Solver solver(c.scene, *backend, options);
    const Result result = solver.solve();
    ASSERT_EQ(result.status, Status::solved) << what << ": " << result.reason;
    ASSERT_TRUE(result.errors);
    const auto grids = Index(result.errors->grids.size());
    ASSERT_GE(grids, 3) << what;
    const PreparationCounts made = solver.made(), alone = made_alone(c, *backend, result.errors->grids);
    EXPECT_LE(made.classifications, 1) << what;
    EXPECT_LE(made.spectra, 1) << what;
    EXPECT_LE(made.exponentials, alone.exponentials) << what;
    if (c.method == Method::march && alone.exponentials == grids) {
      EXPECT_LE(made.exponentials, 2) << what;
    }
    EXPECT_LE(made.fits, 1) << what;
    EXPECT_LE(made.shifted_solves, alone.shifted_solves * 8 / 10) << what;
    if (c.name == "dense" || c.name == "mass") {
      EXPECT_EQ(alone.exponentials, grids) << "one a grid without sharing";
    }
    if (c.name == "signorini") {
      EXPECT_EQ(alone.fits, grids);
    }
    if (c.name == "sparse") {
      EXPECT_GT(alone.shifted_solves, 0);
    }

    Options last;  // the same numbers as the last grid on its own
    last.method = c.method;
    last.steps = result.steps;
    if (c.method == Method::multigrid) continue;  // whose cycles end at a part of the error of the grid
    if (has_own_steps(result)) continue;
    const Result single = bromwich::solve(c.scene, *backend, last);
    ASSERT_EQ(single.y.rows(), result.y.rows()) << what;
    EXPECT_LE((single.y - result.y).cwiseAbs().maxCoeff(), 1e-10 * std::max(1.0, single.y.cwiseAbs().maxCoeff()))
        << what;
  }
}

TEST(Solver, KeepsTheGridsOfATolerance) {
  const auto backend = make_cpu_backend(2);
  for (const SolverCase& c : tolerance_cases()) {
    const std::string what = c.name + " " + to_string(c.method) + " to a tolerance";
    Options options;
    options.method = c.method;
    options.tolerance = c.tolerance;
    options.states = StateSelection::list;
    options.components = {0};
    Solver solver(c.scene, *backend, options);
    const Result first = solver.solve();
    expect_same(first, bromwich::solve(c.scene, *backend, options), what);
    const PreparationCounts made = solver.made();
    expect_same(solver.solve(), first, what + " again");
    EXPECT_EQ(solver.made().exponentials, made.exponentials) << what;
    EXPECT_EQ(solver.made().shifted_solves, made.shifted_solves) << what;

    Scene changed = c.scene;
    changed.x0 = 0.9 * c.scene.x0;
    changed.g = times(0.95, c.scene.g);
    changed.f = times(1.1, c.scene.f);
    if (!c.scene.boundary) solver.set_x0(changed.x0);
    solver.set_sources(changed.f, changed.g, changed.breakpoints);
    const Result second = solver.solve();
    expect_same(second, bromwich::solve(changed, *backend, options), what + " changed");
    const PreparationCounts now = solver.made();
    EXPECT_EQ(now.fits, made.fits) << what;
    EXPECT_EQ(now.spectra, made.spectra) << what;
    EXPECT_EQ(now.classifications, made.classifications) << what;
    if (second.steps <= first.steps) {
      EXPECT_EQ(now.exponentials, made.exponentials) << what;
    }
  }
}

// Coarse grids are given up where all of them together exceed the limit; the numbers stay.
TEST(Solver, KeepsOnlyTheGridsThatFit) {
  const auto backend = make_cpu_backend(1);
  Options options;
  options.method = Method::march;
  options.tolerance = 1e-4;
  Solver free(dense_scene(), *backend, options);
  const Result expected = free.solve();
  options.memory_limit = 1.2 * double(expected.bytes_predicted);
  Solver limited(dense_scene(), *backend, options);
  expect_same(limited.solve(), expected, "with a memory limit");
  expect_same(limited.solve(), expected, "with a memory limit, again");
}

}  // namespace
}  // namespace bromwich::solver_test
