// Error estimates from differences of grids: exact for powers of the step, robust against differences that are small by
// chance, and against jumps that stay within a step.

#include "core/accuracy/convergence.hpp"
#include "core/solve/solve.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

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

// Orders indistinguishable from q count as q, which changes the estimate by sqrt(2) at most.
TEST(GridDifferences, AnOrderCloseToTheHighestIsTheHighest) {
  for (const double q : {1.0, 2.0, 3.0})
    for (double order = 0.5; order <= q; order += 0.01) {
      const double fall = std::exp2(-order), first = 1 - fall;
      const GridDifferences d = differences(q, {first, first * fall, first * fall * fall});
      EXPECT_LE(d.error(), std::pow(fall, 3) * (1 + 1e-14)) << order;
      EXPECT_GE(d.error(), std::pow(fall, 3) / std::sqrt(2) * (1 - 1e-14)) << order;
      EXPECT_NEAR(d.order(), d.order() == q ? q : order, 1e-14);
      EXPECT_TRUE(order > q - 0.5 || d.order() < q) << order;
    }
}

// Errors c_k h^2 with c_k within sqrt(2) of 1, as for switches anywhere between grid points. With p <= 2, D >= d_k >=
// c_k - c_{k+1}/4 and c_k >= c_{k+1}/2, the estimate is at least (4/2 - 1)/3 = 1/3 of the error. The mean of three
// improves this: few estimates leave [1/2, 3].
TEST(GridDifferences, OfScatteredErrorsGiveTheirSize) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> scatter(-0.5, 0.5);
  int good = 0;
  constexpr int samples = 2000;
  for (int sample = 0; sample < samples; ++sample) {
    std::vector<double> errors, falls;
    for (int k = 0; k < 4; ++k) errors.push_back(std::exp2(scatter(random) - 2 * k));
    for (int k = 0; k < 3; ++k) falls.push_back(errors[k] - errors[k + 1]);
    const double ratio = differences(2, falls).error() / errors[3];
    EXPECT_GE(ratio, 1.0 / 3);
    if (ratio >= 0.5 && ratio <= 3) ++good;
  }
  EXPECT_GE(good, 0.9 * samples);
}

// Differences that alternate around the trend h^2 by factors of 2: the estimate is between 1/2 and 3 times the error of
// the trend, 4^-k/3.
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
  EXPECT_NEAR(d.error(true), std::sqrt(1e-9 * std::cbrt(4e-9) / 4) / 3, 1e-14) << "a check would show it";
  EXPECT_TRUE(d.changes_abruptly());
  EXPECT_TRUE(differences(2, {4, 1e-9, 1}).changes_abruptly());
  EXPECT_FALSE(differences(2, {4, 1, 0.02}).changes_abruptly());
  EXPECT_FALSE(differences(2, {1e-12, 1e-12, 1e-15}).changes_abruptly()) << "rounding";
}

TEST(GridDifferences, AreRegularWhereTheirOrderStays) {
  EXPECT_TRUE(differences(2, {4, 2, 1}).regular());
  EXPECT_FALSE(differences(2, {8, 2, 1}).regular());
  EXPECT_FALSE(differences(2, {2, 1}).regular());
  EXPECT_FALSE(differences(2, {0, 0, 0}).regular());
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

/// y(t) on J steps of [0, 1], as computed by a method with discontinuous y.
Result sampled(Index J, const std::function<double(double)>& y) {
  Result result;
  result.method = Method::march;
  result.continuous = false;
  result.status = Status::solved;
  result.steps = J;
  result.t = Vector::LinSpaced(J + 1, 0, 1);
  result.x_components = {0};
  result.y.resize(J + 1, 1);
  result.x.resize(J + 1, 1);
  for (Index j = 0; j <= J; ++j) result.y(j, 0) = result.x(j, 0) = y(double(j) / double(J));
  return result;
}

/// Absolute errors.
const ComponentSizes in_units_of_the_scene{.one_y = {}, .one_x = {}, .relative = false};

TEST(Distance, OfAComponentIsRelativeToItOrAThousandthOfTheLargest) {
  Result a = sampled(4, [](double) { return 0.0; }), b = a;
  a.x_components = b.x_components = {0, 1, 2};
  b.x = RowMatrix{{0, 0, 0}, {8, 0.5, 1e-6}, {4, 0.25, 0}, {0, 0, 0}, {0, 0, 0}};
  a.x = RowMatrix{{0, 0, 0}, {9, 0.5, 1e-6}, {4, 0.5, 4e-6}, {0, 0, 0}, {0, 0, 0}};
  const Distance d = distance(a, 1, b, 1);
  EXPECT_NEAR(d.x[0], 1.0 / 8, 1e-15);
  EXPECT_NEAR(d.x[1], 0.25 / 0.5, 1e-15);
  EXPECT_NEAR(d.x[2], 4e-6 / 8e-3, 1e-15);
  EXPECT_EQ(d.y, 0) << "of a y that is 0 on both";
}

TEST(Distance, IsThatOfCommonTimePoints) {
  const Result a = sampled(12, [](double t) { return t + 0.125; }), b = sampled(16, [](double t) { return t; });
  const Distance d = distance(a, 3, b, 4, in_units_of_the_scene);
  EXPECT_NEAR(d.y, 0.125, 1e-15);
  EXPECT_NEAR(d.of_x(), 0.125, 1e-15);
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
  Convergence convergence(integrated, before, in_units_of_the_scene);
  for (std::size_t k = 1; k < grids.size(); ++k) {
    const Result next = sampled(grids[k], y);
    convergence.add(before, next, true);
    before = next;
  }
  return convergence;
}

// A jump behind a point common to all grids: y and its mean agree on all grids, but each knows the jump only to within
// a step, h/2 on average, so the mean over [0, 1] has an error of 1/(2 J).
TEST(Convergence, JumpsThatStayInTheirStepsAreSeen) {
  const auto step = [](double t) { return t > 0.5 ? 1.0 : 0.0; };
  const Convergence c = on_grids({16, 32, 64, 128, 256}, step);
  EXPECT_TRUE(c.of_integral());
  EXPECT_NEAR(c.error(), 0.5 / 256, 1e-15);
}

// A jump at any time is known to within a step, so the mean over [0, 1] has an error below 1/J.
TEST(Convergence, JumpsAnywhereAreNotUnderestimated) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> anywhere(0.2, 0.8);
  for (int sample = 0; sample < 20; ++sample) {
    const double t = anywhere(random);
    const Index J = 512;
    const double error = t - std::floor(t * double(J)) / double(J);  // of the sum of rows
    const Convergence c = on_grids({32, 64, 128, 256, J}, [t](double s) { return s > t ? 1.0 : 0.0; });
    EXPECT_TRUE(c.of_integral());
    EXPECT_GE(c.error(), 0.5 * error) << t;
  }
}

/// Two components of x, errors first[c] J^-order[c].
Result with_errors(Index J, const Vector& first, const Vector& order) {
  Result result = sampled(J, [](double) { return 0.0; });
  result.continuous = true;
  result.x_components = {0, 1};
  result.x.resize(J + 1, 2);
  for (Index c = 0; c < 2; ++c) result.x.col(c).setConstant(first[c] * std::pow(double(J), -order[c]));
  return result;
}

// 8 J^-2 hides J^-1 / 4: at J = 64 it is half as large, but its last difference is still the larger one.
TEST(Convergence, AComponentOfXThatConvergesMoreSlowlyIsSeen) {
  const Vector first{{8, 0.25}}, order{{2, 1}};
  Result before = with_errors(4, first, order);
  Convergence c(integrated, before, in_units_of_the_scene);
  for (const Index J : {8, 16, 32, 64}) {
    const Result next = with_errors(J, first, order);
    c.add(before, next, true);
    EXPECT_GT(before.x(1, 0) - next.x(1, 0), before.x(1, 1) - next.x(1, 1)) << J;
    before = next;
  }
  EXPECT_NEAR(c.error_of_x(), before.x(1, 1), 1e-14);
  EXPECT_NEAR(c.states().error(), before.x(1, 1) / 2, 1e-14) << "of the largest differences";
}

TEST(Convergence, WaitsWhereTheGridBeforeDidNotResolve) {
  const Vector none{{0, 0}};
  const auto on = [&](Index J, double error) {
    Result result = with_errors(J, none, none);
    result.y.setConstant(error);
    return result;
  };
  const double errors[] = {8, 4, 1, 1e-4, 2.5e-5};  // differences 4, 3, 1, 7.5e-5
  Convergence c(integrated, on(16, errors[0]), in_units_of_the_scene);
  for (int k = 1; k < 5; ++k) {
    c.add(on(8 << k, errors[k - 1]), on(16 << k, errors[k]), true);
    EXPECT_EQ(c.can_be_judged(1e-3), k == 3) << k;
  }
  c.add(on(256, errors[4]), on(512, errors[4] / 4), true);
  EXPECT_TRUE(c.can_be_judged(1e-3));
  EXPECT_NEAR(c.controlled().order(), 2, 1e-14);
}

// Differences of x that vanish between two grids are accidental if y jumps: a jump known to within a step moves x by
// |B| h/2.
TEST(Convergence, StatesDoNotConvergeByChance) {
  Result before = sampled(16, [](double t) { return t > 0.5 ? 1.0 : 0.0; });
  Convergence c(integrated, before, in_units_of_the_scene);
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
  Convergence c(integrated, before, in_units_of_the_scene);
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
