// Errors from differences of grids: exact for powers of the step, not fooled by differences that are small by chance,
// and by jumps that stay in their steps.

#include "core/convergence.hpp"
#include "core/solve.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

namespace bromwich {
namespace {

GridDifferences differences(double order, const std::vector<double>& values) {
  GridDifferences d(order);
  for (const double value : values) d.add(value);
  return d;
}

TEST(GridDifferences, OfAPowerOfTheStepAreExtrapolatedExactly) {
  for (const double order : {0.75, 1.0, 1.5, 2.0}) {  // errors h^p, p at most 2: differences h^p (1 - 2^-p)
    const double fall = std::exp2(-order), first = 1 - fall;
    const GridDifferences d = differences(2, {first, first * fall, first * fall * fall});
    EXPECT_TRUE(d.confirmed());
    EXPECT_NEAR(d.order(), order, 1e-14);
    EXPECT_NEAR(d.error(), std::pow(fall, 3), 1e-14);
    EXPECT_FALSE(d.stands_still());
  }
}

TEST(GridDifferences, TheOrderIsThatOfTwoHalvings) {
  EXPECT_NEAR(differences(2, {8, 4, 1}).order(), 1.5, 1e-14);
  EXPECT_NEAR(differences(2, {8, 2, 1}).order(), 1.5, 1e-14);
}

// Differences that alternate around their trend h^2, by factors of 2: the estimate is between 1/2 and 3 of the error
// of the trend, 4^-k/3.
TEST(GridDifferences, ThatFallIrregularlyAreSmoothed) {
  for (const bool high_last : {false, true}) {
    const double up = 2, down = 0.5;
    const GridDifferences d =
        high_last ? differences(2, {16 * up, 4 * down, up}) : differences(2, {16 * down, 4 * up, down});
    const double error = 1.0 / 3;
    EXPECT_GE(d.error(), 0.5 * error);
    EXPECT_LE(d.error(), 3 * error);
  }
}

TEST(GridDifferences, OneThatIsSmallByChanceIsNotBelieved) {
  const GridDifferences d = differences(2, {4, 1, 1e-9});
  EXPECT_NEAR(d.error(), 0.25 / 3, 1e-14);  // as if it had fallen with the full order
}

TEST(GridDifferences, WithoutOrderAreNotConfirmed) {
  EXPECT_TRUE(std::isnan(differences(2, {1}).error()));
  EXPECT_FALSE(differences(2, {1, 0.25}).confirmed());
  EXPECT_TRUE(differences(2, {1, 0.9, 1.1}).stands_still());
  EXPECT_FALSE(differences(2, {1, 0.5, 0.26}).stands_still());
  EXPECT_TRUE(differences(2, {1e-13, 2e-13, 1e-13, 2e-13}).stalled(2));
  EXPECT_FALSE(differences(1, {1, 0.6, 0.1, 0.3}).stalled(2)) << "one difference may rise";
}

TEST(GridDifferences, OfTheSameSolutionAreNoError) {
  const GridDifferences d = differences(2, {0, 0, 0});
  EXPECT_EQ(d.error(), 0);
  EXPECT_FALSE(d.stalled(2));
}

// ---- of results ----

/// y(t) on J steps of [0, 1] as a method with discontinuous y would give it.
Result sampled(Index J, const std::function<double(double)>& y) {
  Result result;
  result.method = to_string(Method::march);
  result.continuous = false;
  result.status = Status::solved;
  result.steps = J;
  result.x_components = {0};
  result.y.resize(J + 1, 1);
  result.x.resize(J + 1, 1);
  for (Index j = 0; j <= J; ++j) result.y(j, 0) = result.x(j, 0) = y(double(j) / double(J));
  return result;
}

TEST(Distance, IsThatOfCommonTimePoints) {
  const Result a = sampled(12, [](double t) { return t + 0.125; }), b = sampled(16, [](double t) { return t; });
  const Distance d = distance(a, 3, b, 4);
  EXPECT_NEAR(d.y, 0.125, 1e-15);  // sizes below 1 count as 1
  EXPECT_NEAR(d.x, 0.125, 1e-15);
  // Means of 1/12 Σ (i/12 + 1/8) and 1/16 Σ i/16 over all: (1/2 + 1/24 + 1/8) - (1/2 + 1/32).
  EXPECT_NEAR(d.mean, 1.0 / 24 + 0.125 - 1.0 / 32, 1e-15);
}

TEST(LargestJumps, DoNotCountImpulses) {
  RowMatrix y = RowMatrix::Zero(21, 1);
  y(10, 0) = 1e6;
  EXPECT_EQ(largest_jumps(y)[0], 0);
  y.bottomRows(8).setConstant(3);
  EXPECT_EQ(largest_jumps(y)[0], 3);
}

/// x' = 3 y.
Scene integrator() {
  Scene scene;
  scene.dynamics = DenseDynamics{.A = Matrix{{0}}, .B = Matrix{{3}}, .N = Matrix{{1}}};
  scene.M = Matrix{{0}};
  scene.x0 = Vector{{0}};
  return scene;
}
const Scene integrated = integrator();

Convergence on_grids(const std::vector<Index>& grids, const std::function<double(double)>& y) {
  Result before = sampled(grids.front(), y);
  Convergence convergence(integrated, before);
  for (std::size_t k = 1; k < grids.size(); ++k) {
    const Result next = sampled(grids[k], y);
    convergence.add(before, next, true);
    before = next;
  }
  return convergence;
}

// A jump behind a point that all grids have: their y and its mean are the same, but each knows the jump to within a
// step only, h/2 expected, which makes the mean over [0, 1] wrong by 1/(2 J).
TEST(Convergence, JumpsThatStayInTheirStepsAreSeen) {
  const auto step = [](double t) { return t > 0.5 ? 1.0 : 0.0; };
  const Convergence c = on_grids({16, 32, 64, 128, 256}, step);
  EXPECT_TRUE(c.of_integral());
  EXPECT_NEAR(c.error(), 0.5 / 256, 1e-15);
}

// Differences of x that vanish from one grid to the next are chance where y jumps: the jump, known to within a step,
// moves x by |B| h/2.
TEST(Convergence, StatesDoNotConvergeByChance) {
  Result before = sampled(16, [](double t) { return t > 0.5 ? 1.0 : 0.0; });
  Convergence c(integrated, before);
  for (const Index J : {32, 64, 128, 256}) {
    Result next = sampled(J, [](double t) { return t > 0.5 ? 1.0 : 0.0; });
    next.x.setConstant(J < 100 ? 1 / double(J) : 0.01);
    c.add(before, next, true);
    before = next;
  }
  EXPECT_NEAR(c.error_of_x(), 3.0 / 256, 1e-15);
}

TEST(Convergence, TheCheckSeesWhatHalvedStepsDoNot) {
  const double t = 0.625;
  const auto smooth = [&](double shift) { return [=](double s) { return std::exp(-s) + shift; }; };
  Result before = sampled(16, smooth(0));
  Convergence c(integrated, before);
  for (const Index J : {32, 64, 128}) {
    const Result next = sampled(J, smooth(1e-3 / double(J * J)));
    c.add(before, next, true);
    before = next;
  }
  EXPECT_TRUE(c.wants_check());
  const double alone = c.error();
  c.check(sampled(96, smooth(t)), before);
  EXPECT_FALSE(c.wants_check());
  EXPECT_NEAR(c.error(), t * std::pow(0.75, c.controlled().order()), 1e-6);
  EXPECT_GT(c.error(), 100 * alone);
}

}  // namespace
}  // namespace bromwich
