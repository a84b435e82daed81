// Cycles in w against implicit Euler step by step, and against the dense oracle.

#include "core/multigrid/dual.hpp"

#include "core/catalogue/catalogue.hpp"
#include "core/result/result.hpp"
#include "core/scene/component_names.hpp"
#include "core/solve/solver.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>
#include <Eigen/LU>

#include <cmath>
#include <memory>

namespace bromwich {
namespace {

using reference::Random;

// w to the iteration tolerance of 1e-12, V to 1e-13 of V_0, which is below 1e2 on these grids.
constexpr double same_y = 2e-10;

Options euler_options(Index steps) {
  Options options = options_for(Method::dual, steps);
  options.tuning.dual_by_euler = true;
  return options;
}
Result run_by_euler(const Scene& scene, Index steps) { return run(scene, euler_options(steps)); }

Scene compliant(double Q, double eps, double c = 0.05) {
  return make_scene("contact", {{"Q", Q}, {"eps", eps}, {"c", c}});
}

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

Scene random_contact(std::uint32_t seed, Index m, Index n, double compliance) {
  Random random(seed);
  const Matrix A = random.matrix(m, m) - 2.0 * Matrix::Identity(m, m), B = random.matrix(m, n);
  Scene scene;
  scene.name = "random";
  scene.dynamics = DenseDynamics{A, B, B.transpose()};
  scene.M = Matrix(compliance * Matrix::Identity(n, n));
  scene.f = [m](double t, Eigen::Ref<Vector> f) {
    for (Index i = 0; i < m; ++i) f[i] = std::cos(t + double(i));
  };
  scene.g = [n](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < n; ++i) g[i] = std::cos(5 * t + 0.3 * double(i)) - 0.5;
  };
  scene.x0 = Vector::Zero(m);
  return scene;
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

// The ratio of successive changes of w, mean of the cycles before rounding.
double contraction_of(const Result& r) {
  double product = 1;
  int count = 0;
  for (std::size_t i = 1; i < r.history.size() && r.history[i] > 1e-11; ++i, ++count)
    product *= r.history[i] / r.history[i - 1];
  return count > 0 ? std::pow(product, 1. / count) : 0;
}

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

// ---- stages of Radau IIA ----

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

TEST(DualCycles, SolveWhatRadauSolvesStepByStep) {
  for (const double eps : {0., 1e-2, 1e-1}) {
    const Scene scene = compliant(4, eps);
    const Result found = run(scene, Method::dual, 64);
    ASSERT_EQ(found.status, Status::solved) << found.reason;
    const RowMatrix y = radau_oracle(oracle::write_out(scene), 64);
    EXPECT_LE(distance(found.y.bottomRows(64), y.bottomRows(64)), same_y) << eps;
    EXPECT_GT(y.maxCoeff(), 0.1);
  }
}

TEST(DualCycles, SolveWhatMarchingInStagesSolves) {
  expect_stage_march(compliant(4, 0), 64);
  for (const double c : {0.05, 1.}) expect_stage_march(compliant(15, 0, c), 128);
}

TEST(DualCycles, TakeSourcesAndAStartAtTheStages) {
  Scene scene = compliant(4, 0);
  scene.f = [](double t, Eigen::Ref<Vector> phi) {
    for (Index i = 0; i < phi.size(); ++i) phi[i] = -0.3 * std::sin(4 * t + double(i));
  };
  scene.f_entry = SourceEntry::through_B;
  expect_stage_march(scene, 64);
  for (Index i = 0; i < scene.x0.size(); ++i) scene.x0[i] = 0.1 + 0.05 * std::sin(double(i));
  expect_stage_march(scene, 64);
}

// A line of cells with conductivities that differ, one constraint for each row of cells at its left end.
Scene varying(Index rows, Index columns, double compliance) {
  const Index m = rows * columns;
  std::vector<Eigen::Triplet<double>> A, B, N;
  const auto cell = [columns](Index i, Index k) { return i * columns + k; };
  const auto conductivity = [](Index a, Index b) { return 0.05 * (1 + 0.5 * std::sin(double(a + 2 * b))); };
  const double cells = double(columns + 1);
  const auto join = [&](Index a, Index b) {
    const double c = conductivity(a, b) * cells * cells;
    A.emplace_back(a, b, c);
    A.emplace_back(b, a, c);
    A.emplace_back(a, a, -c);
    A.emplace_back(b, b, -c);
  };
  for (Index i = 0; i < rows; ++i) {
    for (Index k = 0; k < columns; ++k) {
      if (k + 1 < columns) join(cell(i, k), cell(i, k + 1));
      if (i + 1 < rows) join(cell(i, k), cell(i + 1, k));
    }
    A.emplace_back(cell(i, columns - 1), cell(i, columns - 1), -0.1 * cells * cells);
    B.emplace_back(cell(i, 0), i, cells);
    N.emplace_back(i, cell(i, 0), 1);
  }
  SparseDynamics d;
  d.A.resize(m, m);
  d.B.resize(m, rows);
  d.N.resize(rows, m);
  d.A.setFromTriplets(A.begin(), A.end());
  d.B.setFromTriplets(B.begin(), B.end());
  d.N.setFromTriplets(N.begin(), N.end());
  Scene scene;
  scene.name = "varying";
  scene.dynamics = d;
  scene.M = Matrix(compliance * Matrix::Identity(rows, rows));
  scene.x0 = Vector::Zero(m);
  scene.T = 4;
  scene.g = [rows](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < rows; ++i) g[i] = 0.5 * std::sin(3 * t) * (1 - std::exp(-5 * t)) * std::sin(0.4 + double(i));
  };
  return scene;
}

// Above the number of states up to which sparse dynamics are written out as dense ones.
TEST(DualCycles, SolveSparseScenes) {
  const Scene scene = varying(23, 23, 0);
  Options cycles = options_for(Method::dual, 64), steps = options_for(Method::march, 64);
  steps.tuning.substitutes_euler = false;
  const Result found = run(scene, cycles), expected = run(scene, steps);
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  EXPECT_GT(expected.y.maxCoeff(), 0.1);
  ASSERT_FALSE(expected.continuous);
  EXPECT_NE(found.kernel.find("stages of Radau IIA"), std::string::npos) << found.kernel;
  EXPECT_LE(distance(found.y.bottomRows(64), expected.y.bottomRows(64)), 1e-8 * std::max(1., expected.y.maxCoeff()));
  const Result euler = run_by_euler(scene, 64), one_stage = run(scene, Method::euler, 64);
  ASSERT_EQ(euler.status, Status::solved) << euler.reason;
  EXPECT_LE(distance(euler.y.bottomRows(64), one_stage.y.bottomRows(64)), 1e-8 * std::max(1., expected.y.maxCoeff()));
}

// The defect of the coarse grid, implicit Euler with the same step, is what limits the cycles.
TEST(DualCycles, ContractAtTheStages) {
  for (const double Q : {15., 31.}) {
    const Result found = run(compliant(Q, 0), Method::dual, 256);
    ASSERT_EQ(found.status, Status::solved) << found.reason;
    EXPECT_LE(contraction_of(found), 0.3) << Q;
    EXPECT_LE(found.iterations, 4 * found.cycles);
  }
}

// Means over time, where an active set that changes inside a step counts little.
TEST(DualCycles, AreMoreAccurateAtTheStagesThanByEuler) {
  const Scene scene = compliant(15, 0);
  const RowMatrix exact = integral_of_y(run(scene, Method::dual, 2048))(Eigen::seq(0, 2048, 16), Eigen::all),
                  stages = integral_of_y(run(scene, Method::dual, 128)),
                  euler = integral_of_y(run_by_euler(scene, 128));
  EXPECT_LT(10 * distance(stages, exact), distance(euler, exact));
}

// American options: every state is constrained, and V is local.
TEST(DualCycles, AreStepsInWWhereVIsLocal) {
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

// ---- American options ----

double value_at_the_spot(const Scene& scene, Method method, Index steps) {
  Options options = options_for(method, steps);
  options.states = StateSelection::list;
  options.components = {find_state(scene, "spot")};
  const Result r = run(scene, options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  return r.x(r.x.rows() - 1, 0);
}

// Published values. The error of the mesh is of order two, 6.4e-5 with 800 points, and 41 over their square; twice
// that.
TEST(DualCycles, ValueAmericanPuts) {
  struct Known {
    ParameterValues parameters;
    double value;
  };
  const std::vector<Known> puts{
      {{{"q", 0.05}, {"sigma", 0.25}}, 9.569445299}, {{}, 6.0903706}, {{{"S", 36}, {"K", 40}, {"r", 0.06}}, 4.4866744}};
  for (const Known& put : puts)
    for (const double points : {100., 200.}) {
      ParameterValues parameters = put.parameters;
      parameters["points"] = points;
      EXPECT_NEAR(value_at_the_spot(make_scene("put", parameters), Method::dual, 200), put.value,
                  82 / (points * points));
    }
}

// With two dividends of two per cent, against a binomial tree: 7.55751 to 3.2e-4 (scripts/put_reference).
TEST(DualCycles, ValueAmericanPutsWithDividends) {
  const Scene scene = make_scene("put", {{"dividend", 0.02}, {"dividends", 2}, {"points", 600}});
  EXPECT_NEAR(value_at_the_spot(scene, Method::dual, 100), 7.55751, 3.2e-4 + 82. / 360000);
}

// The lower of two prices: 11.98751 to 5.7e-5 by trees. The error is of order two in the points, 0.036 with 30 less
// that with 60, so that 43 over their square is expected; twice that.
TEST(DualCycles, ValueAmericanPutsOnTwoAssets) {
  for (const double points : {24., 32.})
    EXPECT_NEAR(value_at_the_spot(make_scene("put-on-two", {{"points", points}}), Method::automatic, 16), 11.98751,
                86 / (points * points) + 5.7e-5);
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
