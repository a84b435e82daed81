// Solves on arrays of the backend against marching by the public entry, which shares neither the sweeps nor r.

#include "core/solve/array_solver.hpp"

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/seam/shared_memory.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich::array_solver_test {
namespace {

constexpr Index J = 64;
/// The sweeps end below 1e-12 of y; weights of marching and sweeps are those of one kernel, to 1e-10 where it is
/// fitted.
constexpr double same = 1e-8;

double f_of(double t, Index i) { return 0.3 * std::cos(3 * t + double(i)); }
double g_of(double t, Index i) { return -0.5 * std::sin(2 * t + 0.1 * double(i)); }

RowMatrix table(const Scene& scene, double (*value)(double, Index)) {
  RowMatrix rows(J + 1, scene.constraints());
  for (Index j = 0; j <= J; ++j)
    for (Index i = 0; i < rows.cols(); ++i) rows(j, i) = value(scene.T * double(j) / double(J), i);
  return rows;
}

TimeFunction linear(const RowMatrix& rows, double T) {
  return [rows, T](double t, Eigen::Ref<Vector> value) {
    const double at = t / T * double(J);
    const Index j = std::min(Index(at), J - 1);
    const double share = at - double(j);
    value = ((1 - share) * rows.row(j) + share * rows.row(j + 1)).transpose();
  };
}

Scene with_sources(Scene scene) {
  scene.f = linear(table(scene, f_of), scene.T);
  scene.f_entry = SourceEntry::through_B;
  scene.F = {};
  scene.g = linear(table(scene, g_of), scene.T);
  scene.exact = {};
  scene.breakpoints.clear();
  for (Index j = 1; j < J; ++j) scene.breakpoints.push_back(scene.T * double(j) / double(J));
  scene.breakpoints_are_all = true;
  return scene;
}

/// M is strictly diagonally dominant.
Scene small_dense() {
  Scene scene;
  scene.dynamics = DenseDynamics{.A = Matrix{{-1, 2, 0}, {-2, -1, 0}, {0, 0.5, -3}},
                                 .B = Matrix{{1, 0}, {0.5, 1}, {0, 2}},
                                 .N = Matrix{{1, 0, 1}, {0, 1, 0}}};
  scene.M = Matrix{{2, 0.5}, {-0.7, 1.5}};
  scene.x0 = Vector{{0.1, -0.2, 0.3}};
  scene.T = 3;
  return scene;
}

RowMatrix downloaded(Backend& backend, const Array& array) {
  RowMatrix values;
  backend.download(array, values);
  return values;
}

void expect_as_marched(const Scene& given, const Vector* x0 = nullptr) {
  const auto backend = make_cpu_backend(2);
  Scene scene = with_sources(given);
  ArraySolver solver(scene, *backend, {.steps = J});
  auto& memory = dynamic_cast<SharedMemory&>(*backend);
  memory.read(table(scene, g_of).data(), solver.g());
  memory.read(table(scene, f_of).data(), solver.phi());
  if (x0) {
    solver.solve();  // of another x0
    solver.set_x0(*x0);
    scene.x0 = *x0;
  }
  Result found = solver.solve();
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  const Result expected = solve(scene, *backend, {.method = Method::march, .steps = J, .trace = true});
  ASSERT_EQ(expected.status, Status::solved) << expected.reason;
  const RowMatrix y = downloaded(*backend, solver.y()), w = downloaded(*backend, solver.w());
  const double size = std::max(1.0, expected.y.cwiseAbs().maxCoeff());
  EXPECT_GT(expected.y.maxCoeff(), 1e-3);
  EXPECT_LE((y - expected.y).cwiseAbs().maxCoeff(), same * size);
  const RowMatrix slack = expected.trace + table(scene, g_of) + expected.y * to_dense(scene.M).transpose();
  EXPECT_LE((w - slack).cwiseAbs().maxCoeff(), same * std::max(1.0, slack.cwiseAbs().maxCoeff()));
  EXPECT_LE(y.cwiseMin(w).cwiseAbs().maxCoeff(), 1e-10 * std::max(1.0, slack.cwiseAbs().maxCoeff()));
}

TEST(ArraySolver, GivesWhatMarchingGives) {
  expect_as_marched(make_scene("signorini", {{"Q", 15}}));  // sine modes, tridiagonal M
  expect_as_marched(small_dense());
  Scene sparse = make_scene("signorini", {{"Q", 24}});
  sparse.dynamics = to_sparse(get<KroneckerDynamics>(sparse.dynamics));
  expect_as_marched(sparse);  // more than 512 states
}

TEST(ArraySolver, TakesAnotherX0) {
  const Scene scene = make_scene("signorini", {{"Q", 15}});
  const Vector x0 = Vector::LinSpaced(scene.states(), 0, 0.3);
  expect_as_marched(scene, &x0);
}

TEST(ArraySolver, RefusesWhatItCannotSolve) {
  const auto backend = make_cpu_backend(1);
  const auto refused = [&](const Scene& scene) {
    return refusal([&] { ArraySolver solver(scene, *backend, {.steps = J}); });
  };
  EXPECT_NE(refused(make_scene("periodic-rectifier")).find("boundary values"), std::string::npos);
  Scene impulsive = small_dense();
  impulsive.M = Matrix::Zero(2, 2);
  EXPECT_NE(refused(impulsive).find("march"), std::string::npos);
}

TEST(ArraySolver, ReportsValuesThatAreNotFinite) {
  const auto backend = make_cpu_backend(1);
  const Scene scene = small_dense();
  ArraySolver solver(scene, *backend, {.steps = J});
  auto& memory = dynamic_cast<SharedMemory&>(*backend);
  RowMatrix g = table(scene, g_of);
  g(J / 2, 0) = NAN;
  memory.read(g.data(), solver.g());
  EXPECT_NE(solver.solve().status, Status::solved);
  memory.read(table(scene, g_of).data(), solver.g());
  EXPECT_EQ(solver.solve().status, Status::solved);  // nothing of it stays
}

}  // namespace
}  // namespace bromwich::array_solver_test
