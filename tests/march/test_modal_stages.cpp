// Radau IIA on a Kronecker sum in sine modes, against full states.

#include "catalogue/catalogue.hpp"
#include "core/march/stages.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

Options stages(Index J, RecurrenceChoice choice = RecurrenceChoice::automatic, bool substitutes = false) {
  Options options = options_for(Method::march, J);
  options.tuning.recurrence = choice;
  options.tuning.substitutes_euler = substitutes;
  return options;
}

// A start and a source through B, beside the contact.
Scene driven_contact(double Q) {
  Scene scene = make_scene("contact", {{"Q", Q}, {"T", 1}});
  for (Index i = 0; i < scene.x0.size(); ++i) scene.x0[i] = 0.1 + 0.05 * std::sin(double(i));
  scene.f = [](double t, Eigen::Ref<Vector> phi) {
    for (Index i = 0; i < phi.size(); ++i) phi[i] = -0.3 * std::sin(4 * t + double(i));
  };
  scene.f_entry = SourceEntry::through_B;
  return scene;
}

// Every step by the dense stage system and enumeration of active sets.
RowMatrix by_the_oracle(const oracle::DenseScene& dense, Index J) {
  const oracle::Steps steps(dense, oracle::Scheme::radau, J);
  const Index n = dense.M.rows();
  RowMatrix rows = RowMatrix::Constant(J + 1, n, NAN);
  Vector x = dense.x0, y = Vector::Zero(n), Y = Vector::Zero(2 * n);
  rows.row(0).setZero();
  for (Index j = 1; j <= J; ++j) {
    const oracle::StepProblem p = steps.problem(j, x, y);
    const auto found = oracle::step_solution(dense, p, Y);
    if (!found) return rows;
    Y = *found;
    x = p.free + p.drive * Y;
    y = Y.tail(n);
    rows.row(j) = y.transpose();
  }
  return rows;
}

TEST(ModalStages, SolveTheStageEquations) {
  for (const Scene& scene : {make_scene("contact", {{"Q", 4}}), driven_contact(4)}) {
    const Index J = 48;
    const Result found = run(scene, stages(J));
    ASSERT_EQ(found.status, Status::solved) << found.reason;
    EXPECT_NE(found.kernel.find("eigenvalues a mode"), std::string::npos) << found.kernel;
    const oracle::DenseScene dense = oracle::write_out(scene);
    const RowMatrix y = by_the_oracle(dense, J);
    // The inverse of M + W_0 is below 1e2 here.
    EXPECT_LE(distance(found.y.bottomRows(J), y.bottomRows(J)), 100 * same_problem);
    EXPECT_GT(y.maxCoeff(), 1e-3);  // there is contact
    EXPECT_EQ(found.euler_steps, 0);
  }
}

TEST(ModalStages, AgreeWithTheSceneWrittenOut) {
  Scene scene = driven_contact(12), sparse = scene;
  sparse.dynamics = to_sparse(get<KroneckerDynamics>(scene.dynamics));
  Options options = stages(96);
  options.states = StateSelection::list;
  options.components = {0, 1, 17, 143};
  const Result found = run(scene, options), expected = run(sparse, options);
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  ASSERT_EQ(expected.status, Status::solved) << expected.reason;
  EXPECT_LE(distance(found.y, expected.y), 100 * same_problem);
  EXPECT_LE(distance(found.x, expected.x), 100 * same_problem);
}

TEST(ModalStages, AreTheSameWithFewPoles) {
  const Scene scene = make_scene("contact", {{"Q", 63}, {"eps", 0}});
  const Result few = run(scene, stages(128, RecurrenceChoice::compressed)),
               all = run(scene, stages(128, RecurrenceChoice::modal));
  ASSERT_EQ(few.status, Status::solved) << few.reason;
  ASSERT_EQ(all.status, Status::solved) << all.reason;
  EXPECT_NE(few.kernel.find("poles a mode"), std::string::npos) << few.kernel;
  // Weights to 1e-13 of K, and the inverse of M + W_0 of size 100.
  EXPECT_LE(distance(few.y, all.y), 1e-10);
}

TEST(ModalStages, SubstituteEulerStepsWhereTheStateJumps) {
  const Scene scene = make_scene("contact", {{"Q", 12}});
  const Result with = run(scene, stages(64, RecurrenceChoice::automatic, true)), without = run(scene, stages(64));
  ASSERT_EQ(with.status, Status::solved) << with.reason;
  EXPECT_GT(with.euler_steps, 0);
  EXPECT_EQ(without.euler_steps, 0);
}

// Contacts that begin and end along a side, with a pressure that does not jump: steps of Radau IIA are right, and
// taking them by Euler costs an order. The reference has no such steps and eight times as many; its error is a 64th or
// less.
TEST(ModalStages, ContactsThatMoveAreNoJumps) {
  const Scene scene = make_scene("contact", {{"Q", 15}, {"eps", 0}});
  constexpr Index J = 256, finer = 8;
  const Result with = run(scene, stages(J, RecurrenceChoice::automatic, true)), without = run(scene, stages(J)),
               reference = run(scene, stages(finer * J));
  ASSERT_EQ(reference.status, Status::solved) << reference.reason;
  const auto error = [&](const Result& r) {
    double worst = 0;
    for (Index j = 1; j <= J; ++j)
      worst = std::max(worst, (r.y_integral.row(j) - reference.y_integral.row(finer * j)).cwiseAbs().maxCoeff());
    return worst;
  };
  EXPECT_GT((without.y.array() > 0).count(), 100);
  EXPECT_LE(with.euler_steps, J / 20);
  EXPECT_LE(error(with), 2 * error(without));
}

}  // namespace
}  // namespace bromwich
