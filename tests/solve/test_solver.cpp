// A Solver against a fresh solve of the changed scene.

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

std::vector<SolverCase> cases() {
  std::vector<SolverCase> all;
  for (const Method m : {Method::march, Method::contour, Method::multigrid, Method::euler, Method::automatic}) {
    all.push_back({"signorini", make_scene("signorini", {{"Q", 15}}), m});
    all.push_back({"signorini of 60 lines", make_scene("signorini", {{"Q", 60}}), m});
    all.push_back({"dlcp-small", make_scene("dlcp-small"), m});
    all.push_back({"sparse", sparse_signorini(), m});
  }
  all.push_back({"bridge", make_scene("bridge"), Method::automatic, 200});
  all.push_back({"bridge by galerkin", make_scene("bridge"), Method::galerkin, 100});
  all.push_back({"ladder-diodes", make_scene("ladder-diodes"), Method::automatic, 200});
  all.push_back({"ladder", make_scene("ladder"), Method::automatic, 200});
  all.push_back({"dlcp-small to a tolerance", make_scene("dlcp-small"), Method::automatic, 32, 1e-3});
  return all;
}

void expect_solves_of_changed_scenes(Backend& on, const std::vector<SolverCase>& all) {
  Backend* const backend = &on;
  for (const SolverCase& c : all) {
    const std::string what = c.name + " " + to_string(c.method) + " on " + on.name();
    Options options;
    options.method = c.method;
    options.steps = c.steps;
    options.tolerance = c.tolerance;
    options.states = StateSelection::list;
    options.components = {0, c.scene.states() - 1};
    Solver solver(c.scene, *backend, options);
    const Result first = solver.solve();
    expect_same(first, bromwich::solve(c.scene, *backend, options), what);
    expect_same(solver.solve(), first, what + " again");

    Scene changed = c.scene;
    changed.exact = {};
    changed.x0 = 0.5 * c.scene.x0 + Vector::Constant(c.scene.states(), 0.01);
    solver.set_x0(changed.x0);
    expect_same(solver.solve(), bromwich::solve(changed, *backend, options), what + " with another x0");

    changed.f = times(1.2, c.scene.f);
    changed.g = times(1.1, c.scene.g);
    solver.set_sources(changed.f, changed.g);
    expect_same(solver.solve(), bromwich::solve(changed, *backend, options), what + " with other sources");

    solver.set_sources(c.scene.f, c.scene.g);
    solver.set_x0(c.scene.x0);
    expect_same(solver.solve(), first, what + " as at first");
  }
}

TEST(Solver, IsTheSolveOfTheChangedScene) { expect_solves_of_changed_scenes(*make_cpu_backend(2), cases()); }

// Large enough for fitted exponentials, and for x0 to go to the device in pieces.
TEST(Solver, IsTheSolveOfTheChangedSceneOnADevice) {
  if (cuda_devices().empty()) GTEST_SKIP() << "no CUDA device";
  std::vector<SolverCase> some;
  for (const Method m : {Method::march, Method::contour, Method::multigrid})
    for (const double Q : {60., 255.}) some.push_back({"signorini", make_scene("signorini", {{"Q", Q}}), m, 256});
  expect_solves_of_changed_scenes(*make_cuda_backend(make_cpu_backend(2)), some);
}

// Between the points of a grid nothing changes: all kept, one part of it anew, then the other.
TEST(Solver, TakesWhatHasChangedAndKeepsTheRest) {
  const auto backend = make_cpu_backend(2);
  Options options;
  options.method = Method::multigrid;
  options.steps = 256;
  Scene scene = make_scene("signorini", {{"Q", 127}});
  Solver solver(scene, *backend, options);
  solver.solve();
  scene.exact = {};
  for (int round = 0; round < 3; ++round) {
    scene.x0 *= 0.9;
    solver.set_x0(Vector(scene.x0));
    expect_same(solver.solve(), bromwich::solve(scene, *backend, options), "x0");
    expect_same(solver.solve(), bromwich::solve(scene, *backend, options), "the same x0");
    scene.f = times(1.1, scene.f);
    solver.set_sources(scene.f, scene.g);
    expect_same(solver.solve(), bromwich::solve(scene, *backend, options), "f");
    scene.f = {};
    solver.set_sources(scene.f, scene.g);
    expect_same(solver.solve(), bromwich::solve(scene, *backend, options), "no f");
    scene.f = make_scene("signorini", {{"Q", 127}}).f;
    solver.set_sources(scene.f, scene.g);
    expect_same(solver.solve(), bromwich::solve(scene, *backend, options), "f again");
  }
}

TEST(Solver, SourcesThatJumpAndThatComeAndGo) {
  const auto backend = make_cpu_backend(1);
  Scene scene = make_scene("dlcp-small");
  Options options;
  options.steps = 50;
  options.states = StateSelection::all;
  Solver solver(scene, *backend, options);
  solver.solve();
  for (const double at : {0.313, 0.5, 0.0}) {
    Scene changed = scene;
    changed.f = [at, m = scene.states()](double t, Eigen::Ref<Vector> f) { f = Vector::Constant(m, t < at ? 1 : -1); };
    changed.f_entry = SourceEntry::state;
    if (scene.f_entry != SourceEntry::state) continue;
    changed.breakpoints = {at};
    if (at == 0) changed.f = {}, changed.breakpoints = {};
    for (const Method method : {Method::march, Method::euler}) {
      options.method = method;
      Solver other(scene, *backend, options);
      other.solve();
      other.set_sources(changed.f, changed.g, changed.breakpoints);
      expect_same(other.solve(), bromwich::solve(changed, *backend, options), "jump at " + std::to_string(at));
    }
  }
}

// Documented reuse: another g needs no shifted solve.
TEST(Solver, KeepsTheShiftedSolves) {
  Scene scene = sparse_signorini();
  const SparseDynamics sparse = get<SparseDynamics>(scene.dynamics);
  const auto calls = std::make_shared<int>(0);
  SuppliedDynamics own;
  own.states = sparse.A.rows();
  own.B = sparse.B;
  own.N = sparse.N;
  own.bound = SpectralBound{};
  own.shifted = [A = sparse.A, calls](Complex z) -> ShiftedSolve {
    ++*calls;
    Eigen::SparseMatrix<Complex> shifted(A.rows(), A.cols());
    shifted.setIdentity();
    shifted = z * shifted - A.cast<Complex>();
    const auto lu = std::make_shared<Eigen::SparseLU<Eigen::SparseMatrix<Complex>>>(shifted);
    return [lu](const ComplexMatrix& R) -> ComplexMatrix { return lu->solve(R); };
  };
  scene.dynamics = own;
  Options options;
  options.method = Method::march;
  options.steps = 40;
  const auto backend = make_cpu_backend(1);
  Solver solver(scene, *backend, options);
  solver.solve();
  const int first = *calls;
  EXPECT_GT(first, 0);
  solver.set_sources(scene.f, times(0.9, scene.g));
  EXPECT_EQ(solver.solve().status, Status::solved);
  EXPECT_EQ(*calls, first);
  solver.set_x0(0.5 * scene.x0 + Vector::Constant(scene.states(), 0.01));
  solver.solve();
  EXPECT_GT(*calls, first);
}

// How f enters the reduced scene depends on which sources exist: with a mass matrix and with free rows.
TEST(Solver, SourcesThatComeToReducedScenes) {
  const auto backend = make_cpu_backend(1);
  Options options;
  options.steps = 60;
  options.method = Method::march;
  options.states = StateSelection::all;
  const TimeFunction f = [](double t, Eigen::Ref<Vector> value) { value << std::sin(3 * t), 1, t; },
                     g = [](double t, Eigen::Ref<Vector> value) { value << std::cos(2 * t), 0.1 - t; };
  for (const bool mass : {true, false}) {
    Scene scene;
    scene.dynamics =
        DenseDynamics{-Matrix::Identity(3, 3), Matrix{{1, 0}, {0, 1}, {1, 1}}, Matrix{{1, 0, 0}, {0, 1, 1}},
                      mass ? Matrix{{2, 1, 0}, {0, 3, 0}, {1, 0, 1}} : Matrix()};
    scene.M = Matrix{{1, 0.2}, {0.1, 2}};
    if (!mass) scene.free_rows = {1};
    scene.x0 = Vector::Constant(3, 0.3);
    scene.g = g;
    Solver solver(scene, *backend, options);
    expect_same(solver.solve(), bromwich::solve(scene, *backend, options), "without f");
    for (const TimeFunction& now : {f, TimeFunction(), times(2, f)}) {
      Scene changed = scene;
      changed.f = now;
      solver.set_sources(now, g);
      expect_same(solver.solve(), bromwich::solve(changed, *backend, options),
                  std::string(mass ? "mass" : "free rows") + (now ? " with f" : " without f"));
    }
  }
}

// Sources that agree at all grid points and differ elsewhere.
TEST(Solver, SourcesThatDifferBetweenPointsOrInTheirShapes) {
  const auto backend = make_cpu_backend(1);
  Options options;
  options.steps = 40;
  options.method = Method::march;
  Scene scene = sparse_signorini();
  const Index n = scene.constraints();
  const TimeFunction amplitude = [](double t, Eigen::Ref<Vector> a) { a[0] = std::sin(4 * t); };
  const auto pulse = [h = scene.T / 40](double end) -> TimeFunction {
    return [=](double t, Eigen::Ref<Vector> value) { value.setConstant(t > 3.2 * h && t < end * h ? 5.0 : 0.0); };
  };
  Scene changed = scene;
  changed.exact = {};
  Solver solver(scene, *backend, options);
  for (const double width : {1.0, 2.0}) {
    changed.f = SeparableSource{Matrix::Constant(n, 1, width), amplitude};
    solver.set_sources(changed.f, changed.g);
    expect_same(solver.solve(), bromwich::solve(changed, *backend, options), "another shape");
  }
  for (const double end : {3.5, 3.9}) {
    changed.f = pulse(end);
    changed.breakpoints = {3.2 * scene.T / 40, end * scene.T / 40};
    solver.set_sources(changed.f, changed.g, changed.breakpoints);
    expect_same(solver.solve(), bromwich::solve(changed, *backend, options), "another pulse inside a step");
  }
}

TEST(Solver, GoalTakesTheNewInput) {
  const auto backend = make_cpu_backend(1);
  Options options;
  options.method = Method::goal;
  options.steps = 60;
  options.states = StateSelection::all;
  Scene scene = make_scene("ladder");
  Solver solver(scene, *backend, options);
  const Result first = solver.solve();
  solver.set_sources(times(3, scene.f), scene.g);
  const Result found = solver.solve();
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  EXPECT_GT(found.x.cwiseAbs().maxCoeff(), 1.5 * first.x.cwiseAbs().maxCoeff()) << "three times the input";
}

// Options are copied, including what they point to; a failing source leaves no partial state.
TEST(Solver, KeepsItsOwnStartAndSurvivesSourcesThatThrow) {
  const auto backend = make_cpu_backend(1);
  const Scene scene = make_scene("dlcp-small");
  Options options;
  options.steps = 48;
  options.method = Method::contour;
  auto start = std::make_unique<RowMatrix>(RowMatrix::Zero(49, scene.constraints()));
  options.tuning.first_iterate = start.get();
  Solver solver(scene, *backend, options);
  const Result first = solver.solve();
  start.reset();
  expect_same(solver.solve(), first, "after the start is gone");
  int calls = 0;
  solver.set_sources(
      [&calls](double, Eigen::Ref<Vector> f) {
        f.setZero();
        if (++calls > 20) throw std::runtime_error("the source of the user");
      },
      scene.g);
  EXPECT_THROW(solver.solve(), std::runtime_error);
  solver.set_sources(scene.f, scene.g);
  expect_same(solver.solve(), first, "after a source that threw");
}

TEST(Solver, RefusesWhatDoesNotFitAndStaysAsItWas) {
  const auto backend = make_cpu_backend(1);
  const Scene scene = make_scene("dlcp-small");
  Options options;
  options.steps = 32;
  Solver solver(scene, *backend, options);
  const Result first = solver.solve();
  EXPECT_NE(refusal([&] { solver.set_x0(Vector::Zero(scene.states() + 1)); }).find("x0"), std::string::npos);
  EXPECT_NE(refusal([&] { solver.set_x0(Vector::Constant(scene.states(), NAN)); }).find("x0"), std::string::npos);
  EXPECT_NE(refusal([&] { solver.set_sources({}, {}, {2 * scene.T}); }).find("breakpoints"), std::string::npos);
  expect_same(solver.solve(), first, "after refusals");
  Solver boundary(make_scene("periodic-rectifier"), *backend, options);
  EXPECT_NE(refusal([&] { boundary.set_x0(Vector::Zero(1)); }).find("boundary"), std::string::npos);
}

}  // namespace
}  // namespace bromwich::solver_test
