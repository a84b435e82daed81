// Random scenes of every class and spectrum against the oracle: no result may claim something false.
// bench/random_scenes.cpp runs many more.

#include "tests/support/run.hpp"
#include "tests/support/verdict.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include <cmath>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace bromwich::oracle {
namespace {

constexpr std::uint32_t count = 500;

Result solved(const RandomScene& random, Method method) {
  Options options = options_for(method, random.steps);
  options.states = StateSelection::all;
  return run(random.scene, options);
}

TEST(RandomScenes, NothingFailsSilently) {
  const auto backend = make_cpu_backend(1);
  std::set<std::string> statuses;
  Index solved = 0, missed = 0;
  for (std::uint32_t seed = 0; seed < count; ++seed) {
    const RandomScene random = any_scene(seed);
    const DenseScene dense = write_out(random.scene);
    for (const Method method : {Method::automatic, Method::march, Method::contour, Method::euler}) {
      const Trial trial = try_method(random, dense, method, *backend);
      EXPECT_EQ(trial.failure, "") << "seed " << seed << ", " << bromwich::to_string(method) << ", "
                                   << to_string(random.family) << ": " << trial.status << ", " << trial.reason;
      statuses.insert(trial.status);
      solved += method == Method::automatic && trial.status == "solved";
      missed += method == Method::automatic && trial.missed;
    }
  }
  // The scenes must reach every status of the solver.
  for (const char* status : {"solved", "infeasible", "tolerance_not_met", "unsupported"})
    EXPECT_TRUE(statuses.contains(status)) << status;
  // Most scenes are solved; the others magnify errors on coarse grids, though the oracle solves the steps.
  EXPECT_GT(solved, Index(0.75 * count));
  EXPECT_LE(missed, Index(0.04 * count));
}

TEST(RandomScenes, ScenesThatNeedCare) {
  const auto backend = make_cpu_backend(1);
  const std::vector<std::pair<std::uint32_t, Method>> cases{
      {16059, Method::contour},    // windows in time, and several solutions where two windows meet
      {13749, Method::contour},    //
      {2595, Method::march},       // one branch of solutions ends, another one leads to T
      {5748, Method::euler},       //
      {23162, Method::march},      //
      {25941, Method::automatic},  // M is P, M + W_0 is not: a step without a solution proves nothing
      {7530, Method::march},       // the same, solved with four times the steps
      {3076, Method::march},       // M skew, h B N small: pivots of 1e-5 in the matrix of the step
      {52, Method::euler},         // the state jumps to zero and stays there
      {18103, Method::march},      //
      {1549, Method::euler},       // duplicated constraints, y_0 of least norm
  };
  for (const auto& [seed, method] : cases) {
    const RandomScene random = any_scene(seed);
    const Trial trial = try_method(random, write_out(random.scene), method, *backend);
    EXPECT_EQ(trial.failure, "") << "seed " << seed << ", " << bromwich::to_string(method) << ": " << trial.status;
    EXPECT_LE(trial.violation, 1e-8) << "seed " << seed;
  }
}

TEST(RandomScenes, EveryFamilyIsOfItsClass) {
  for (std::uint32_t seed = 0; seed < 330; ++seed) {
    const RandomScene random = any_scene(seed);
    const Matrix& M = std::get<Matrix>(random.scene.M);
    const LcpClass found = class_of(M);
    const std::string name = to_string(random.family);
    if (name.starts_with("P,") || random.family == Family::m_matrix) {
      EXPECT_EQ(found, LcpClass::P) << name << " " << seed;
    }
    // A matrix of low rank with a skew part may be P.
    if (name.starts_with("PSD") && !(random.family == Family::low_rank && found == LcpClass::P)) {
      EXPECT_EQ(found, LcpClass::PSD) << name << " " << seed;
    }
    if (random.scene.lcp_class == LcpClass::Z) {
      Matrix off = M;
      off.diagonal().setZero();
      EXPECT_LE(off.maxCoeff(), 0) << seed;
    }
  }
}

// ---- the judge can fail ----

// Adds 1e-5 of the largest value to a row of y or x of a solved result.
template <class Change>
void expect_found(Method method, const Change& change) {
  Index tried = 0, found = 0;
  for (std::uint32_t seed = 0; seed < 44; ++seed) {
    const RandomScene random = any_scene(seed);
    Result result = solved(random, method);
    if (result.status != Status::solved || result.rough_steps > 0 || !(result.y.maxCoeff() > 0)) continue;
    const DenseScene dense = write_out(random.scene);
    ASSERT_EQ(judge(dense, result).failure, "") << seed;
    change(result);
    ++tried;
    found += !judge(dense, result).failure.empty();
  }
  EXPECT_GE(tried, 10);
  // A change that leaves a solution (a state without effect and observation) cannot be found.
  EXPECT_GE(found, tried - 1);
}

TEST(Judge, FindsAWrongY) {
  for (const Method method : {Method::march, Method::euler})
    expect_found(method, [](Result& r) { r.y.row(r.steps / 2).array() += 1e-5 * r.y.maxCoeff(); });
}

TEST(Judge, FindsAWrongState) {
  for (const Method method : {Method::march, Method::euler})
    expect_found(method, [](Result& r) { r.x.row(r.steps / 2).array() += 1e-5 * r.x.cwiseAbs().maxCoeff(); });
}

TEST(Judge, FindsAWrongResidual) {
  expect_found(Method::march, [](Result& r) { r.residual += 1e-3 * std::max(1.0, r.x.cwiseAbs().maxCoeff()) * 1e9; });
}

TEST(Judge, FindsFalseInfeasibility) {
  for (const Method method : {Method::march, Method::euler})
    expect_found(method, [](Result& r) {
      r.status = Status::infeasible;
      r.infeasible_at = r.t[r.steps / 2];
    });
}

TEST(Judge, KnowsTheDiscretisations) {
  // A result of one scheme is not a result of another.
  expect_found(Method::euler, [](Result& r) { r.method = Method::march; });
}

// ---- Radau IIA of the oracle ----

Scene linear(const Matrix& A, const Vector& x0) {
  Scene scene;
  const Index m = A.rows();
  scene.dynamics = DenseDynamics{A, Matrix::Zero(m, 1), Matrix::Zero(1, m)};
  scene.M = Matrix::Identity(1, 1);
  scene.x0 = x0;
  return scene;
}

TEST(OracleSteps, RadauHasOrderThree) {
  const Matrix A{{-0.5, 3}, {-3, -0.5}};
  const Vector x0{{1, 2}};
  const DenseScene s = write_out(linear(A, x0));
  const auto error = [&](Index J) {
    return (trajectory(s, Scheme::radau, J).x.row(J).transpose() - oracle::exponential(A) * x0).norm();
  };
  // 2^3 = 8 when the step is halved, up to the next order.
  EXPECT_NEAR(error(40) / error(80), 8, 0.4);
  EXPECT_LT(error(80), 1e-4);
}

TEST(OracleSteps, StabilityFunctionOfRadau) {
  // R(z) = (1 + z/3)/(1 - 2z/3 + z^2/6).
  for (const double z : {-1e3, -1.0, 0.5}) {
    const DenseScene s = write_out(linear(Matrix::Constant(1, 1, z), Vector::Ones(1)));
    EXPECT_NEAR(trajectory(s, Scheme::radau, 1).x(1, 0), (1 + z / 3) / (1 - 2 * z / 3 + z * z / 6), 1e-15);
  }
}

// x' = y, 0 <= y ⊥ x - (t - 1/2) >= 0: a wall moving right with speed 1 pushes x once it arrives.
Scene wall(double x0) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix::Zero(1, 1), Matrix::Ones(1, 1), Matrix::Ones(1, 1)};
  scene.M = Matrix::Zero(1, 1);
  scene.g = [](double t, Eigen::Ref<Vector> g) { g[0] = 0.5 - t; };
  scene.x0 = Vector::Constant(1, x0);
  return scene;
}

TEST(OracleSteps, RadauFollowsAMovingWall) {
  const Trajectory found = trajectory(write_out(wall(0)), Scheme::radau, 8);
  ASSERT_EQ(found.infeasible, -1);
  for (Index j = 0; j <= 8; ++j) {
    // Linear in time, and 1/2 is a time point: exact.
    EXPECT_NEAR(found.x(j, 0), std::max(0.0, found.t[j] - 0.5), 1e-15) << j;
    EXPECT_NEAR(found.y(j, 0), j > 0 && found.t[j] > 0.5 ? 1 : 0, 1e-14) << j;
  }
}

TEST(OracleSteps, AJumpIsTakenByEuler) {
  // The wall is at -1/2 at t = 0 and x0 = -1 is behind it: y is an impulse, x = t_1 - 1/2 after one step.
  const Trajectory found = trajectory(write_out(wall(-1)), Scheme::radau, 8);
  ASSERT_EQ(found.infeasible, -1);
  EXPECT_TRUE(std::isnan(found.y(0, 0)));
  EXPECT_NEAR(found.x(1, 0), found.t[1] - 0.5, 1e-15);
  EXPECT_NEAR(found.y(1, 0), (found.x(1, 0) + 1) / found.t[1], 1e-13);
  EXPECT_NEAR(found.y(2, 0), 1, 1e-13);
}

TEST(OracleSteps, SelectedSolutions) {
  // y_1 + y_2 = 1 in all of them; the least norm is (1/2, 1/2).
  const auto norm = selected_solution(Matrix::Ones(2, 2), Vector::Constant(2, -1), LcpClass::PSD);
  ASSERT_TRUE(norm);
  EXPECT_LE((*norm - Vector::Constant(2, 0.5)).norm(), 1e-15);
  // The fold y_1 >= 2 y_2 - 1, ...: (1, 0) is the least solution for q = (-1, 3).
  const auto least = selected_solution(Matrix{{1, -2}, {-2, 1}}, Vector{{-1, 3}}, LcpClass::Z);
  ASSERT_TRUE(least);
  EXPECT_LE((*least - Vector{{1, 0}}).norm(), 1e-15);
  EXPECT_FALSE(selected_solution(Matrix::Zero(1, 1), Vector::Constant(1, -1), LcpClass::PSD));
}

}  // namespace
}  // namespace bromwich::oracle
