// Cycles in w against implicit Euler step by step, and against the dense oracle.

#include "core/multigrid/dual.hpp"

#include "core/result/result.hpp"
#include "core/solve/solver.hpp"
#include "tests/multigrid/dual_scenes.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>
#include <Eigen/LU>

#include <cmath>
#include <memory>

namespace bromwich {
namespace {

using reference::Random;

// ---- the same solution ----

TEST(DualCycles, SolveWhatTheOracleSolves) {
  for (const double eps : {0., 1e-2, 1e-1}) {
    const Scene scene = compliant(4, eps);
    const Result found = run_by_euler(scene, 64);
    ASSERT_EQ(found.status, Status::solved) << found.reason;
    EXPECT_EQ(found.form, "dual");
    const RowMatrix y = oracle::euler(oracle::write_out(scene), 64).y;
    EXPECT_LE(distance(found.y, y), same_y) << eps;
    EXPECT_GT(y.maxCoeff(), 0.1);
    EXPECT_LE(found.residual, 1e-9);
  }
}

TEST(DualCycles, SolveWhatImplicitEulerSolves) {
  for (const double c : {0.002, 0.05, 1.}) {
    const Scene scene = compliant(31, 0, c);
    const Result found = run_by_euler(scene, 256), expected = run(scene, Method::euler, 256);
    ASSERT_EQ(found.status, Status::solved) << c << ' ' << found.reason;
    EXPECT_LE(distance(found.y, expected.y), same_y * std::max(1., expected.y.maxCoeff())) << c;
  }
}

// x0 and a source through B enter by implicit Euler too; states follow from y.
TEST(DualCycles, TakeSourcesAndAStart) {
  Scene scene = compliant(4, 0);
  for (Index i = 0; i < scene.x0.size(); ++i) scene.x0[i] = 0.1 + 0.05 * std::sin(double(i));
  scene.f = [](double t, Eigen::Ref<Vector> phi) {
    for (Index i = 0; i < phi.size(); ++i) phi[i] = -0.3 * std::sin(4 * t + double(i));
  };
  scene.f_entry = SourceEntry::through_B;
  Options options = euler_options(64);
  options.states = StateSelection::all;
  const Result found = run(scene, options);
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  const oracle::Trajectory expected = oracle::euler(oracle::write_out(scene), 64);
  EXPECT_LE(distance(found.y, expected.y), same_y);
  EXPECT_LE(distance(found.x, expected.x), same_y);
}

TEST(DualCycles, SolveDenseScenes) {
  for (const std::uint32_t seed : {1u, 2u, 3u, 4u})
    for (const double compliance : {0., 1e-3}) {
      const Scene scene = random_contact(seed, 4, 2, compliance);
      const Result found = run(scene, Method::dual, 64);
      ASSERT_EQ(found.status, Status::solved) << seed << ' ' << found.reason;
      const RowMatrix y = oracle::euler(oracle::write_out(scene), 64).y;
      // V_0 is of the size 1/h = 64 times the inverse of N B.
      EXPECT_LE(distance(found.y, y), 1e-9 * std::max(1., y.maxCoeff())) << seed;
    }
}

// ---- convergence ----

TEST(DualCycles, ContractWhereDiffusionCrossesACellInAStep) {
  for (const double eps : {0., 1e-2, 1e-1})
    for (const double Q : {15., 31.}) {
      const Result found = run_by_euler(compliant(Q, eps), 256);
      ASSERT_EQ(found.status, Status::solved) << found.reason;
      // c h/dx^2 is 0.2 and 0.8 here: diffusion crosses cells in a step, where cycles should contract by 0.2.
      EXPECT_LE(contraction_of(found), 0.2) << Q << ' ' << eps;
      EXPECT_LE(found.iterations, 4 * found.cycles) << "four sweeps a cycle on the finest grid";
    }
}

// ---- which form ----

TEST(DualCycles, AreTakenByMultigridWhereMLeavesYToTheDynamics) {
  const Result dual = run(compliant(15, 0), Method::multigrid, 64),
               primal = run(make_scene("signorini", {{"Q", 15}}), Method::multigrid, 64);
  EXPECT_EQ(dual.status, Status::solved) << dual.reason;
  EXPECT_EQ(dual.form, "dual");
  EXPECT_EQ(primal.form, "primal");
}

TEST(DualCycles, EndWithAReasonWhereThereIsNoInverse) {
  Scene stop = random_contact(6, 2, 1, 0);
  stop.dynamics = DenseDynamics{Matrix{{0, 1}, {-1, 0}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  stop.g = {};
  stop.x0 = Vector{{1, 0}};
  const Result found = run(stop, Method::dual, 64);
  EXPECT_EQ(found.status, Status::unsupported);
  EXPECT_NE(found.reason.find("second or a higher derivative"), std::string::npos) << found.reason;
  const Result odd = run(compliant(4, 0), Method::dual, 131);
  EXPECT_EQ(odd.status, Status::unsupported);
  EXPECT_NE(odd.reason.find("131 steps"), std::string::npos) << odd.reason;
}

// Random dense scenes: one constraint twice, w without a first derivative by y, zeros on either side. A solution is
// that of implicit Euler step by step, and everything else has a reason.
TEST(DualCycles, ExistOrSayWhyOnRandomScenes) {
  int solved = 0, refused = 0;
  for (std::uint32_t seed = 1; seed <= 12; ++seed) {
    Scene scene = random_contact(seed, 4, 2, 0);
    DenseDynamics d = *scene.dynamics->small_state();
    Random random(100 + seed);
    if (seed % 4 == 0) d.N = random.matrix(2, 4);  // zeros anywhere
    if (seed % 4 == 1) d.N.row(1) = d.N.row(0), d.B.col(1) = d.B.col(0);
    if (seed % 4 == 2) d.N = random.matrix(2, 4);
    if (seed % 4 == 2) d.N -= d.N * d.B * (d.B.transpose() * d.B).inverse() * d.B.transpose();
    scene.dynamics = d;
    const Result found = run(scene, Method::dual, 64);
    if (found.status == Status::solved) {
      ++solved;
      const RowMatrix y = oracle::euler(oracle::write_out(scene), 64).y;
      EXPECT_LE(distance(found.y.bottomRows(64), y.bottomRows(64)), 1e-8 * std::max(1., y.maxCoeff())) << seed;
      continue;
    }
    ++refused;
    EXPECT_EQ(found.status, Status::unsupported) << seed << ' ' << found.reason;
    const char* reason = seed % 4 == 1   ? "repeat each other"
                         : seed % 4 == 2 ? "second or a higher derivative"
                                         : "no cycles";
    EXPECT_NE(found.reason.find(reason), std::string::npos) << seed << ' ' << found.reason;
  }
  EXPECT_GE(solved, 3);
  EXPECT_GE(refused, 6);
}

// w = the response to y less a later and larger one: a zero at z = +1, by which V grows as e^t.
TEST(DualCycles, RefuseAVThatGrows) {
  Scene scene = random_contact(6, 2, 1, 0);
  scene.dynamics = DenseDynamics{Matrix{{-1, 0}, {0, -2}}, Matrix{{1}, {1}}, Matrix{{-2, 3}}};
  scene.T = 20;
  const Result found = run(scene, Method::dual, 64);
  EXPECT_EQ(found.status, Status::unsupported);
  EXPECT_NE(found.reason.find("V grows"), std::string::npos) << found.reason;
}

// A zero at z = 8.5: V grows by e^8.5 = 5e3 up to T, on 32 steps by (1 - 8.5/32)^-32 = 2e4, which is refused. The grids
// end at 64 steps.
TEST(DualCycles, EndAboveAGridWhereVGrowsTooMuch) {
  Scene scene = random_contact(6, 1, 1, 1);
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{-9.5}}, Matrix{{1}}};
  scene.g = [](double t, Eigen::Ref<Vector> g) { g[0] = 0.5 - t; };
  scene.f = {};
  const Result found = run(scene, Method::dual, 256);
  EXPECT_EQ(found.status, Status::solved) << found.reason;
  EXPECT_NE(found.kernel.find("grids of 256, 128, 64 steps"), std::string::npos) << found.kernel;
  const RowMatrix y = oracle::euler(oracle::write_out(scene), 256).y;
  EXPECT_LE(distance(found.y, y), 1e-9 * y.maxCoeff());
}

// Insulated at the far end, the sum of V_d is zero and A is singular.
TEST(DualCycles, SolveWithInsulatedEnds) {
  constexpr Index m = 12;
  Scene scene = random_contact(6, m, 1, 0);
  Matrix A = Matrix::Zero(m, m), B = Matrix::Zero(m, 1), N = Matrix::Zero(1, m);
  for (Index i = 0; i + 1 < m; ++i) {
    A(i, i) -= 7, A(i + 1, i + 1) -= 7;
    A(i, i + 1) += 7, A(i + 1, i) += 7;
  }
  B(0, 0) = 12, N(0, 0) = 1;
  scene.dynamics = DenseDynamics{A, B, N};
  scene.f = {};
  const Result found = run(scene, Method::dual, 64);
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  const RowMatrix y = oracle::euler(oracle::write_out(scene), 64).y;
  EXPECT_GT(y.maxCoeff(), 0.01);
  EXPECT_LE(distance(found.y.bottomRows(64), y.bottomRows(64)), 1e-9 * std::max(1., y.maxCoeff()));
}

// A contact with a compliance that nothing couples to the others: V there is that of an ordinary differential equation.
TEST(DualCycles, SeeAContactFarFromAllOthers) {
  Scene scene = varying(23, 23, 1e-2);
  const Index m = 23 * 23, n = 23;
  SparseDynamics d = *scene.dynamics->matrices();
  d.A.conservativeResize(m + 1, m + 1);
  d.B.conservativeResize(m + 1, n + 1);
  d.N.conservativeResize(n + 1, m + 1);
  d.A.coeffRef(m, m) = -1;
  d.B.coeffRef(m, n) = 1;
  d.N.coeffRef(n, m) = 1;
  scene.dynamics = d;
  scene.M = Matrix(1e-2 * Matrix::Identity(n + 1, n + 1));
  scene.x0 = Vector::Zero(m + 1);
  scene.g = [](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < g.size(); ++i)
      g[i] = 0.5 * std::sin(3 * t) * (1 - std::exp(-5 * t)) * std::sin(0.4 + double(i));
  };
  Options steps = options_for(Method::march, 128);
  steps.tuning.substitutes_euler = false;
  const Result found = run(scene, Method::dual, 128), expected = run(scene, steps);
  ASSERT_EQ(found.status, Status::solved) << found.reason << found.kernel;
  EXPECT_GT(found.y.col(n).maxCoeff(), 0.1);
  // With this compliance march may take the rule that is continuous; it agrees up to the errors of both.
  const double tolerance = expected.continuous ? 0.2 : 1e-7;
  EXPECT_LE(distance(found.y.bottomRows(128), expected.y.bottomRows(128)), tolerance * expected.y.maxCoeff());
}

// ---- starts ----

TEST(DualCycles, ReportAJumpOfTheStateAtTheStart) {
  Scene scene = compliant(4, 0);
  scene.x0.setConstant(-0.2);
  const Result found = run(scene, Method::dual, 64), expected = run(scene, Method::euler, 64);
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  EXPECT_TRUE(found.starts_with_impulse);
  EXPECT_LE(distance(found.y, expected.y), same_y * expected.y.maxCoeff());
}

TEST(DualCycles, SolveAgainWithAnotherStartAndOtherSources) {
  const Scene scene = compliant(15, 0);
  const auto backend = make_cpu_backend(1);
  Solver solver(scene, *backend, euler_options(64));
  const Result first = solver.solve();
  Scene changed = scene;
  changed.x0.setConstant(0.05);
  changed.g = [](double t, Eigen::Ref<Vector> g) { g.setConstant(0.2 * std::sin(7 * t)); };
  solver.set_x0(changed.x0);
  solver.set_sources({}, changed.g);
  const Result again = solver.solve(), expected = run(changed, Method::euler, 64);
  ASSERT_EQ(again.status, Status::solved) << again.reason;
  EXPECT_LE(distance(again.y, expected.y), same_y * std::max(1., expected.y.maxCoeff()));
  solver.set_x0(scene.x0);
  solver.set_sources({}, scene.g);
  const Result back = solver.solve();
  EXPECT_LE(distance(back.y, first.y), same_y);
}

// ---- every backend ----

class DualOnBackend : public BackendTest {};
INSTANTIATE_TEST_SUITE_P(Contract, DualOnBackend, testing::ValuesIn(backend_cases()), backend_case_name);

TEST_P(DualOnBackend, GivesTheSameStages) {
  const Scene scene = compliant(15, 0);
  const Result found = solve(scene, *backend, options_for(Method::dual, 128)), expected = run(scene, Method::dual, 128);
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  EXPECT_LE(distance(found.y, expected.y), same_y * expected.y.maxCoeff());
}

TEST_P(DualOnBackend, GivesTheSamePair) {
  const Scene scene = compliant(15, 0);
  const Result found = solve(scene, *backend, euler_options(128)), expected = run_by_euler(scene, 128);
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  EXPECT_LE(distance(found.y, expected.y), same_y * expected.y.maxCoeff());
}

}  // namespace
}  // namespace bromwich
