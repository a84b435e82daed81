// Cycles in w at the stages of Radau IIA, against marching in stages and the stages written out.

#include "core/result/result.hpp"
#include "core/solve/dense_output.hpp"
#include "tests/multigrid/dual_scenes.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>
#include <Eigen/LU>

#include <cmath>

namespace bromwich {
namespace {

using reference::Random;

Options stage_march(Index steps) {
  Options options = options_for(Method::march, steps);
  options.tuning.substitutes_euler = false;
  options.states = StateSelection::all;
  return options;
}

Options stage_cycles(Index steps) {
  Options options = options_for(Method::dual, steps);
  options.states = StateSelection::all;
  return options;
}

void expect_stage_march(const Scene& scene, Index steps, double tolerance = same_y) {
  const Result found = run(scene, stage_cycles(steps)), expected = run(scene, stage_march(steps));
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  ASSERT_EQ(expected.status, Status::solved) << expected.reason;
  EXPECT_NE(found.kernel.find("stages of Radau IIA"), std::string::npos) << found.kernel;
  EXPECT_LE(found.residual, 1e-9);
  const double size = std::max(1., expected.y.maxCoeff());
  EXPECT_LE(distance(found.y.bottomRows(steps), expected.y.bottomRows(steps)), tolerance * size);
  EXPECT_LE(distance(found.y_integral, expected.y_integral), tolerance * size);
  EXPECT_LE(distance(found.x, expected.x), tolerance * size);
}

// Both stages of every step at once, written out: X = x 1 + h a (A X + B Y), 0 <= Y ⊥ N X + M Y + g >= 0.
RowMatrix radau_oracle(const oracle::DenseScene& s, Index J) {
  const Index m = s.A.rows(), n = s.M.rows();
  const double h = s.T / double(J), a[2][2] = {{5. / 12, -1. / 12}, {3. / 4, 1. / 4}};
  Matrix K = Matrix::Identity(2 * m, 2 * m), D(2 * m, 2 * n);
  for (Index i = 0; i < 2; ++i)
    for (Index k = 0; k < 2; ++k) {
      K.block(i * m, k * m, m, m) -= h * a[i][k] * s.A;
      D.block(i * m, k * n, m, n) = h * a[i][k] * s.B;
    }
  const Matrix inverse = K.inverse(), reach = inverse * D;
  Matrix seen = Matrix::Zero(2 * n, 2 * m), lcp = Matrix::Zero(2 * n, 2 * n);
  for (Index i = 0; i < 2; ++i) {
    seen.block(i * n, i * m, n, m) = s.N;
    lcp.block(i * n, i * n, n, n) = s.M;
  }
  lcp += seen * reach;
  RowMatrix y = RowMatrix::Zero(J + 1, n);
  Vector x = s.x0;
  for (Index j = 1; j <= J; ++j) {
    Vector free(2 * m), g(2 * n);
    for (Index i = 0; i < 2; ++i) {
      const double t = (double(j) - (i == 0 ? 2. / 3 : 0)) * h;
      g.segment(i * n, n) = oracle::value(s.g, t, n);
      free.segment(i * m, m) = x;
      for (Index k = 0; k < 2; ++k)
        free.segment(i * m, m) += h * a[i][k] * oracle::value(s.f, (double(j) - (k == 0 ? 2. / 3 : 0)) * h, m);
    }
    const Vector X = inverse * free;
    const auto Y = oracle::solve_lcp(lcp, seen * X + g, LcpClass::P);
    if (!Y) return RowMatrix::Constant(J + 1, n, NAN);
    x = (X + reach * *Y).tail(m);
    y.row(j) = Y->tail(n).transpose();
  }
  return y;
}

TEST(DualStages, SolveWhatRadauSolvesStepByStep) {
  for (const double eps : {0., 1e-2, 1e-1}) {
    const Scene scene = compliant(4, eps);
    const Result found = run(scene, Method::dual, 64);
    ASSERT_EQ(found.status, Status::solved) << found.reason;
    const RowMatrix y = radau_oracle(oracle::write_out(scene), 64);
    EXPECT_LE(distance(found.y.bottomRows(64), y.bottomRows(64)), same_y) << eps;
    EXPECT_GT(y.maxCoeff(), 0.1);
  }
}

TEST(DualStages, SolveWhatMarchingInStagesSolves) {
  expect_stage_march(compliant(4, 0), 64);
  for (const double c : {0.05, 1.}) expect_stage_march(compliant(15, 0, c), 128);
}

TEST(DualStages, TakeSourcesAndAStartAtTheStages) {
  Scene scene = compliant(4, 0);
  scene.f = [](double t, Eigen::Ref<Vector> phi) {
    for (Index i = 0; i < phi.size(); ++i) phi[i] = -0.3 * std::sin(4 * t + double(i));
  };
  scene.f_entry = SourceEntry::through_B;
  expect_stage_march(scene, 64);
  for (Index i = 0; i < scene.x0.size(); ++i) scene.x0[i] = 0.1 + 0.05 * std::sin(double(i));
  expect_stage_march(scene, 64);
}

// Above the number of states up to which sparse dynamics are written out as dense ones.
TEST(DualStages, SolveSparseScenes) {
  const Scene scene = varying(23, 23, 0);
  Options cycles = options_for(Method::dual, 64), steps = options_for(Method::march, 64);
  steps.tuning.substitutes_euler = false;
  const Result found = run(scene, cycles), expected = run(scene, steps);
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  EXPECT_GT(expected.y.maxCoeff(), 0.1);
  ASSERT_FALSE(expected.continuous);
  EXPECT_NE(found.kernel.find("stages of Radau IIA"), std::string::npos) << found.kernel;
  EXPECT_LE(distance(found.y.bottomRows(64), expected.y.bottomRows(64)), 1e-8 * std::max(1., expected.y.maxCoeff()));
  Options cycles_of_one = euler_options(64), steps_of_one = options_for(Method::euler, 64);
  cycles_of_one.states = steps_of_one.states = StateSelection::all;
  const Result euler = run(scene, cycles_of_one), one_stage = run(scene, steps_of_one);
  ASSERT_EQ(euler.status, Status::solved) << euler.reason;
  EXPECT_LE(distance(euler.x, one_stage.x), 1e-8 * std::max(1., one_stage.x.cwiseAbs().maxCoeff()));
  EXPECT_LE(distance(euler.y.bottomRows(64), one_stage.y.bottomRows(64)), 1e-8 * std::max(1., expected.y.maxCoeff()));
}

// A single step of cycles in w does not exist; between rows it is one of the rule that they solve.
TEST(DualStages, AreStepsOfTheirRuleBetweenRows) {
  const Scene scene = varying(23, 23, 0);
  const auto backend = make_cpu_backend(1);
  for (const bool by_one : {true, false}) {
    Options cycles = by_one ? euler_options(64) : stage_cycles(64),
            steps = by_one ? options_for(Method::euler, 64) : stage_march(64);
    cycles.states = steps.states = StateSelection::all;
    const Result found = solve(scene, *backend, cycles), expected = solve(scene, *backend, steps);
    const std::vector<double> times = {0.371 * scene.T, 0.7123 * scene.T};
    const Result between = at_times(scene, *backend, found, times);
    const Result known = at_times(scene, *backend, expected, times);
    EXPECT_GT(known.y.maxCoeff(), 0.1);
    EXPECT_LE(distance(between.x, known.x), 1e-7 * std::max(1., known.x.cwiseAbs().maxCoeff())) << by_one;
    EXPECT_LE(distance(between.y, known.y), 1e-7 * std::max(1., known.y.maxCoeff())) << by_one;
  }
}

// The defect of the coarse grid, implicit Euler with the same step, is what limits the cycles.
TEST(DualStages, ContractAtTheStages) {
  for (const double Q : {15., 31.}) {
    const Result found = run(compliant(Q, 0), Method::dual, 256);
    ASSERT_EQ(found.status, Status::solved) << found.reason;
    EXPECT_LE(contraction_of(found), 0.3) << Q;
    EXPECT_LE(found.iterations, 4 * found.cycles);
  }
}

// Means over time, where an active set that changes inside a step counts little.
TEST(DualStages, AreMoreAccurateAtTheStagesThanByEuler) {
  const Scene scene = compliant(15, 0);
  const RowMatrix exact = integral_of_y(run(scene, Method::dual, 2048))(Eigen::seq(0, 2048, 16), Eigen::all),
                  stages = integral_of_y(run(scene, Method::dual, 128)),
                  euler = integral_of_y(run_by_euler(scene, 128));
  EXPECT_LT(10 * distance(stages, exact), distance(euler, exact));
}

// American options: every state is constrained, and V is local.
TEST(DualStages, AreStepsInWWhereVIsLocal) {
  constexpr Index m = 90;
  SparseDynamics d;
  std::vector<Eigen::Triplet<double>> A, one;
  for (Index i = 0; i < m; ++i) {
    A.emplace_back(i, i, -800.);
    if (i > 0) A.emplace_back(i, i - 1, 410.);
    if (i + 1 < m) A.emplace_back(i, i + 1, 380.);
    one.emplace_back(i, i, 1.);
  }
  d.A.resize(m, m);
  d.B.resize(m, m);
  d.N.resize(m, m);
  d.A.setFromTriplets(A.begin(), A.end());
  d.B.setFromTriplets(one.begin(), one.end());
  d.N.setFromTriplets(one.begin(), one.end());
  Scene scene;
  scene.name = "obstacle";
  scene.dynamics = d;
  scene.M = Matrix(Matrix::Zero(m, m));
  scene.x0 = Vector::LinSpaced(m, 1.1, 0.1);
  scene.T = 0.1;
  scene.g = [](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < g.size(); ++i)
      g[i] = -0.9 * (1 - double(i) / 89) * (1 - t) - 0.02 * std::sin(0.3 * double(i));
  };
  Options steps = options_for(Method::march, 64);
  steps.tuning.substitutes_euler = false;
  const Result found = run(scene, Method::dual, 64), expected = run(scene, steps);
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  EXPECT_NE(found.kernel.find("V is local"), std::string::npos) << found.kernel;
  EXPECT_LE(found.residual, 1e-9);
  EXPECT_GT(expected.y.maxCoeff(), 1);
  EXPECT_LE(distance(found.y.bottomRows(64), expected.y.bottomRows(64)), 1e-9 * expected.y.maxCoeff());
}

// c h/dx^2 = 3e-5: the stages do not contract, implicit Euler does, and the result says which of them it is.
TEST(DualStages, WhereTheyDoNotContractImplicitEulerDoes) {
  const Scene scene = make_scene("contact", {{"Q", 3}, {"c", 0.0005}, {"eps", 0}});
  const Result found = run(scene, options_for(Method::dual, 1024)),
               euler = run(scene, options_for(Method::euler, 1024));
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  EXPECT_NE(found.warning.find("those of implicit Euler"), std::string::npos) << found.warning;
  EXPECT_LE(found.residual, 1e-9);
  EXPECT_LE(distance(found.y, euler.y), same_y * euler.y.maxCoeff());
}

}  // namespace
}  // namespace bromwich
