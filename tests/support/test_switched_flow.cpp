// The oracle of engineering scenes against values that were published or computed by others, and the solver on a few
// of these scenes. `bromwich_engineering_scenes` judges hundreds.

#include "tests/support/engineering_trial.hpp"
#include "tests/support/run.hpp"
#include "tests/support/stepped_flow.hpp"

#include <gtest/gtest.h>
#include <Eigen/Dense>

namespace bromwich::oracle {
namespace {

EngineeringScene scene(Matrix A, Matrix B, Matrix N, Matrix M, double T) {
  EngineeringScene s;
  s.name = "known";
  s.A = A, s.B = B, s.N = N, s.M = M, s.T = T;
  s.x0 = Vector::Zero(A.rows()), s.weight = Vector::Ones(A.rows());
  return s;
}

// x'' + .05 x' + x = .6 cos 1.7 t + friction of at most .7 on a belt of speed .3, from rest. y1 is the friction plus
// .7.
EngineeringScene mass_on_belt() {
  EngineeringScene s =
      scene(Matrix{{0, 1}, {-1, -0.05}}, Matrix{{0, 0}, {1, 0}}, Matrix{{0, 1}, {0, 0}}, Matrix{{0, 1}, {-1, 0}}, 30);
  s.signals = {{}, {TimeSignal::Kind::sine, 1.7, std::acos(-1.0) / 2, 0}};
  s.F = Matrix{{0, 0}, {-0.7, 0.6}}, s.G = Matrix{{-0.3, 0}, {1.4, 0}};
  return s;
}

// Mass matrix [2 -1; -1 2], force (0, -1), a floor with friction .3 at q2 = 0, q(0) = (0, .1), v(0) = (-1, -1).
EngineeringScene oblique_impact() {
  const Matrix inverse = Matrix{{2, -1}, {-1, 2}}.inverse();
  const Vector normal = inverse.col(1) - 0.3 * inverse.col(0), tangent = inverse.col(0);
  Matrix A = Matrix::Zero(4, 4), B = Matrix::Zero(4, 3), N = Matrix::Zero(3, 4);
  A.topRightCorner(2, 2).setIdentity();
  B.block(2, 0, 2, 1) = normal, B.block(2, 1, 2, 1) = tangent;
  N(0, 1) = 1, N(1, 2) = 1;
  EngineeringScene s = scene(A, B, N, Matrix{{0, 0, 0}, {0, 0, 1}, {0.6, -1, 0}}, 1);
  s.signals = {{}};
  s.F = Matrix::Zero(4, 1), s.G = Matrix::Zero(3, 1);
  s.F.block(2, 0, 2, 1) = -inverse.col(1);
  s.x0 = Vector{{0, 0.1, -1, -1}};
  return s;
}

// Steps err by 1e-9, about thousand of them add up to 1e-6 at most; short steps by the square of their length.
constexpr double oracle_error = 1e-6;
// Those of stepped_flow by 1e-9 as well, but they are ten times as many, of second order, all of one sign.
constexpr double steps_error = 1e-5;

TEST(SwitchedFlow, StickAndSlipOnABelt) {  // by an exact flow with located events and by time stepping
  const Flow flow = switched_flow(mass_on_belt());
  ASSERT_TRUE(flow.decided) << flow.reason;
  EXPECT_NEAR(flow.end()[0], 0.3934447744, oracle_error);
  EXPECT_NEAR(flow.end()[1], 0.3, oracle_error);
  const EngineeringScene s = mass_on_belt();
  const Flow steps = stepped_flow(s, s.x0, s.T);
  ASSERT_TRUE(steps.decided) << steps.reason;
  EXPECT_NEAR(steps.end()[0], 0.3934447744, steps_error);
  EXPECT_NEAR(steps.end()[1], 0.3, steps_error);
}

TEST(SwitchedFlow, ImpactWithFriction) {
  const Flow flow = switched_flow(oblique_impact());
  ASSERT_TRUE(flow.decided) << flow.reason;
  const Vector known{{-0.3086956522, 0, -0.1739130435, 0}};
  EXPECT_LT((flow.end() - known).cwiseAbs().maxCoeff(), oracle_error);
  const EngineeringScene s = oblique_impact();
  const Flow steps = stepped_flow(s, s.x0, s.T);
  ASSERT_TRUE(steps.decided) << steps.reason;
  EXPECT_LT((steps.end() - known).cwiseAbs().maxCoeff(), steps_error);
}

void expect_no_wrong(EngineeringScene (*make)(std::uint32_t), std::uint32_t count) {
  constexpr double tolerance = 1e-3;
  Options options;
  options.states = StateSelection::all;
  options.tolerance = tolerance;
  options.max_seconds = 2;
  const auto backend = make_cpu_backend(1);
  for (std::uint32_t seed = 0; seed < count; ++seed) {
    const EngineeringScene s = make(seed);
    const KnownFlow known = known_flow(s, s.x0, s.T, 0.1 * tolerance);
    if (!known.decided) continue;
    // A scene told otherwise has the same solution.
    const Telling telling = Telling(seed % 4);
    const EngineeringTrial t = try_engineering(s, known, retold(s, telling, seed), options, *backend, tolerance);
    EXPECT_TRUE(t.verdict == "right" || t.verdict == "refused")
        << s.name << ", " << to_string(telling) << ": x is off by " << t.error << " at t = " << t.at;
  }
}

TEST(EngineeringScenes, CircuitsAreNotWrong) { expect_no_wrong(random_circuit, 12); }
TEST(EngineeringScenes, MassesAreNotWrong) { expect_no_wrong(random_masses, 12); }
TEST(EngineeringScenes, TanksAreNotWrong) { expect_no_wrong(random_tanks, 12); }

}  // namespace
}  // namespace bromwich::oracle
