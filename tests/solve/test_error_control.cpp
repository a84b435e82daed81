// Error control: a solved result meets the tolerance, the estimate is close to the true error, and a tolerance out of
// reach is reported.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/result/located.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/error_control.hpp"
#include "tests/support/run.hpp"
#include "tests/support/true_error.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

namespace bromwich::tolerance_test {
namespace {

struct ToleranceCase {
  const char* name;
  ParameterValues parameters;
  Method method;
};

void PrintTo(const ToleranceCase& c, std::ostream* out) { *out << c.name << ' ' << to_string(c.method); }

// On steps of their own lengths the estimate is the difference to twice the step: 2^3 - 1 errors of Radau IIA.
double largest_of(const Result& result) { return has_own_steps(result) ? 8 : largest_effectivity; }

class ReachesTheTolerance : public testing::TestWithParam<std::tuple<ToleranceCase, double>> {};

TEST_P(ReachesTheTolerance, AndSaysHowLargeTheErrorIs) {
  const auto& [chosen, tolerance] = GetParam();
  const Scene scene = make_scene(chosen.name, chosen.parameters);
  const Result result = run(scene, options_to(tolerance, chosen.method));
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  ASSERT_TRUE(result.errors && result.error_estimate);
  EXPECT_LE(*result.error_estimate, tolerance);
  EXPECT_EQ(*result.error_estimate, result.errors->total());
  if (!has_own_steps(result)) {
    EXPECT_EQ(result.errors->grids.back(), result.steps);
    EXPECT_GE(result.errors->grids.size(), 4u) << "two orders want four grids";
  }
  const double error = true_error(scene, result);
  EXPECT_LE(error, tolerance);
  EXPECT_GE(*result.error_estimate, least_effectivity * error);
  EXPECT_LE(*result.error_estimate, largest_of(result) * error);
}

INSTANTIATE_TEST_SUITE_P(SecondOrder, ReachesTheTolerance,
                         testing::Combine(testing::Values(ToleranceCase{"signorini", {{"Q", 15}}, Method::automatic},
                                                          ToleranceCase{"signorini", {{"Q", 15}}, Method::contour},
                                                          ToleranceCase{"signorini", {{"Q", 39}}, Method::automatic},
                                                          ToleranceCase{"dlcp-small", {}, Method::automatic},
                                                          ToleranceCase{"bridge", {}, Method::march}),
                                          testing::Values(1e-2, 1e-3, 1e-4, 1e-5, 1e-6)));
INSTANTIATE_TEST_SUITE_P(FirstOrder, ReachesTheTolerance,
                         testing::Combine(testing::Values(ToleranceCase{"dlcp-small", {}, Method::euler}),
                                          testing::Values(1e-2, 1e-3, 1e-4)));

TEST(ErrorControl, HoldsForTheStatesAskedFor) {
  const Scene scene = make_scene("bridge");
  Options options = options_to(1e-4, Method::march);
  options.states = StateSelection::all;
  const Result result = run(scene, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  RowMatrix known(result.steps + 1, scene.states());
  Vector x(scene.states()), y(scene.constraints());
  for (Index j = 0; j <= result.steps; ++j) {
    scene.exact(result.t[j], x, y);
    known.row(j) = x.transpose();
  }
  double error = 0;
  for (Index c = 0; c < known.cols(); ++c) error = std::max(error, relative(result.x.col(c), known.col(c), 1));
  EXPECT_LE(error, 1e-4);
  EXPECT_GE(result.errors->states, least_effectivity * error);
  EXPECT_LE(result.errors->states, largest_of(result) * error);
  EXPECT_GE(*result.error_estimate, result.errors->states);
  options.control_states = false;
  EXPECT_TRUE(std::isnan(run(scene, options).errors->states));
}

// Everything except A, B, N, M times s: y and x scale with s, on the same grids.
Scene scaled_scene(double s) {
  Scene scene = make_scene("dlcp-small");
  scene.x0 *= s;
  for (TimeFunction* source : {&scene.f, &scene.g})
    if (*source)
      *source = [given = *source, s](double t, Eigen::Ref<Vector> value) {
        given(t, value);
        value *= s;
      };
  scene.exact = {};
  return scene;
}

TEST(ErrorControl, IsRelativeInAnyUnits) {
  const Result plain = run(scaled_scene(1), options_to(1e-4));
  for (const double s : {0x1p-40, 0x1p40}) {
    const Result other = run(scaled_scene(s), options_to(1e-4));
    ASSERT_EQ(other.status, Status::solved) << other.reason;
    EXPECT_EQ(other.errors->grids, plain.errors->grids);
    // A difference of 3e-8 is known to about 1e-15 / 3e-8 in each of the steps between the units.
    EXPECT_NEAR(*other.error_estimate, *plain.error_estimate, 1e-4 * *plain.error_estimate);
  }
}

TEST(ErrorControl, AnAbsoluteToleranceIsInTheUnitsOfTheScene) {
  const Scene scene = make_scene("dlcp-small");
  Options options = options_for(Method::automatic);
  options.absolute_tolerance = 1e-4;
  const Result absolute = run(scene, options);
  ASSERT_EQ(absolute.status, Status::solved) << absolute.reason;
  EXPECT_LE(distance(absolute.y, exact_y(scene, absolute)), 1e-4);
  options.tolerance = 1e-6;  // the two are added
  const Result both = run(scene, options);
  ASSERT_EQ(both.status, Status::solved) << both.reason;
  EXPECT_LE(both.steps, run(scene, options_to(1e-6)).steps);
  EXPECT_LE(distance(both.y, exact_y(scene, both)), 1e-4 + 1e-6);
}

TEST(ErrorControl, OfOneKindAloneLeavesTheOtherOut) {
  const Scene scene = make_scene("bridge");
  Options options = options_for(Method::automatic);
  options.states = StateSelection::all;
  options.tolerance_x = 1e-4;
  const Result of_x = run(scene, options);
  ASSERT_EQ(of_x.status, Status::solved) << of_x.reason;
  EXPECT_EQ(*of_x.error_estimate, of_x.errors->states);
  options.tolerance_x = 0;
  options.tolerance_y = 1e-4;
  const Result of_y = run(scene, options);
  ASSERT_EQ(of_y.status, Status::solved) << of_y.reason;
  EXPECT_TRUE(std::isnan(of_y.errors->states));
  EXPECT_EQ(*of_y.error_estimate, of_y.errors->total());
}

TEST(ErrorControl, EndsWithItsBudget) {
  const Scene scene = make_scene("bridge");
  Options options = options_to(1e-9, Method::march);
  options.max_steps = 2000;
  const Result by_steps = run(scene, options);
  EXPECT_EQ(by_steps.status, Status::tolerance_not_met);
  EXPECT_LE(by_steps.steps, 2000);
  EXPECT_NE(by_steps.reason.find("max-steps"), std::string::npos) << by_steps.reason;
  options.max_steps = Index(1) << 20;
  options.max_seconds = 1e-9;
  for (const Method method : {Method::march, Method::automatic}) {
    options.method = method;
    const Result by_time = run(scene, options);
    EXPECT_EQ(by_time.status, Status::tolerance_not_met);
    EXPECT_NE(by_time.reason.find("max-seconds"), std::string::npos) << by_time.reason;
    EXPECT_EQ(by_time.reason.find("would take"), std::string::npos) << "no time was left: " << by_time.reason;
  }
}

// x' = 1e5 x, which no y changes: steps of implicit Euler with h 1e5 > 2 make x decay, on every grid alike.
TEST(ErrorControl, GridsThatDampGrowthDoNotAgreeOnAnything) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{1e5, 0}, {0, -1}}, Matrix{{0}, {1}}, Matrix{{0.1, 1}}};
  scene.M = Matrix{{1}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = -std::cos(t); };
  scene.x0 = Vector{{1, 0}};
  scene.T = 1;
  scene.default_steps = 100;
  for (const Method method : {Method::euler, Method::dual}) {
    const Result r = run(scene, options_to(1e-2, method));
    EXPECT_NE(r.status, Status::solved) << to_string(method) << ": x(1) is e^(1e5)";
  }
  const Result r = run(scene, options_to(1e-2, Method::euler));
  EXPECT_NE(r.reason.find("grows like e^"), std::string::npos) << r.reason;
}

// Polls outside of a grid, here those of the last look between time points, end the search and not the result.
TEST(ErrorControl, AGridThatWasSolvedSurvivesAnInterruption) {
  constexpr Index n = 50;  // more than located events take
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix::Constant(1, n, 0.01), Matrix::Ones(n, 1)};
  scene.M = Matrix(Matrix::Identity(n, n));
  scene.g = [](double t, Eigen::Ref<Vector> v) { v.setConstant(-std::sin(t)); };
  scene.x0 = Vector{{0}};
  scene.T = 1;
  long polls = 0, most = std::numeric_limits<long>::max();
  Options options = options_to(1e-3, Method::march);
  options.interrupted = [&] { return ++polls > most; };
  ASSERT_EQ(run(scene, options).status, Status::solved);
  const long all = polls;
  for (most = all - 1; most >= all - 3; --most) {
    polls = 0;
    const Result r = run(scene, options);
    EXPECT_EQ(r.status, Status::interrupted);
    EXPECT_EQ(r.reason.find("before the first step"), std::string::npos) << r.reason;
    EXPECT_TRUE(r.y.allFinite());
  }
}

TEST(ErrorControl, NeverEndsBelowTheStepsOfTheScene) {
  for (const char* name : {"dlcp-small", "bridge"}) {
    const Scene scene = make_scene(name);
    EXPECT_GE(run(scene, options_to(0.5)).steps, scene.steps()) << name;
  }
}

// `auto` solves small scenes by located events: the same contract, with estimates that matter where they are large.
TEST(ErrorControl, HoldsForLocatedEvents) {
  const Scene scene = make_scene("bridge");
  for (const double tolerance : {1e-2, 1e-4, 1e-6}) {
    const Result result = run(scene, options_to(tolerance));
    ASSERT_EQ(result.status, Status::solved) << result.reason;
    EXPECT_EQ(result.method, Method::events);
    ASSERT_TRUE(result.errors && result.error_estimate);
    EXPECT_LE(*result.error_estimate, tolerance);
    EXPECT_GE(result.steps, scene.steps());
    const double error = relative(result.y, exact_y(scene, result), 1);
    EXPECT_LE(error, tolerance);
    EXPECT_LE(error, std::max(1e-9, *result.error_estimate / least_effectivity));
  }
}

TEST(ErrorControl, CyclesGoOnWhereSmallComponentsNeedIt) {
  const Scene scene = make_scene("signorini", {{"Q", 39}});
  const Result r = run(scene, options_to(1e-4, Method::multigrid));
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_LE(true_error(scene, r), 1e-4);
}

// x' = -y, w = x - y - 2 t from 1: y = 0 up to t = 1/2, where w would be negative with y = 0 and with any y > 0. That
// y = x - 2 t > 0 from the start ends too is not seen, so nothing is proven.
TEST(ErrorControl, SaysThatNoActiveSetIsASolution) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{-1}}, Matrix{{1}}};
  scene.M = Matrix{{-1}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = -2 * t; };
  scene.x0 = Vector{{1}};
  scene.T = 1;
  for (const Method method : {Method::march, Method::euler}) {
    const Result r = run(scene, options_for(method, 100));
    EXPECT_EQ(r.status, Status::tolerance_not_met) << to_string(method);
    EXPECT_EQ(r.reason.rfind("no active set solves the step to t = 0.5", 0), 0u) << r.reason;
  }
  scene.T = 0.4;
  EXPECT_EQ(run(scene, options_for(Method::march, 100)).status, Status::solved);
}

// A source that takes a millisecond: the search for its jumps alone would take a minute.
TEST(ErrorControl, ASlowSourceEndsWithTheTime) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  long calls = 0;
  scene.g = [&calls](double t, Eigen::Ref<Vector> v) {
    ++calls;
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(1);
    while (std::chrono::steady_clock::now() < end) {
    }
    v[0] = std::sin(t);
  };
  scene.x0 = Vector{{0}};
  scene.T = 1;
  for (const Method method : {Method::automatic, Method::march, Method::events}) {
    calls = 0;
    Options options = options_to(1e-6, method);
    options.max_seconds = 0.05;
    const Result r = run(scene, options);
    EXPECT_EQ(r.status, Status::tolerance_not_met) << to_string(method);
    EXPECT_NE(r.reason.find("max-seconds"), std::string::npos) << r.reason;
    EXPECT_LE(calls, 1000) << to_string(method);
    calls = 0;
    options.max_seconds = 0;
    options.interrupted = [&calls] { return calls > 100; };
    EXPECT_EQ(run(scene, options).status, Status::interrupted) << to_string(method);
    EXPECT_LE(calls, 1000) << to_string(method);
  }
}

// f a square wave with two periods in an interval: y is far from linear there, and moments alone do not tell.
TEST(ErrorControl, GalerkinSaysWhatIntervalsMiss) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{1e-3}};
  const auto square = [](double t) { return std::fmod(200.3 * t, 1) < 0.4 ? 1.0 : -1.0; };
  scene.f = [square](double t, Eigen::Ref<Vector> v) { v[0] = 300 * square(t); };
  scene.x0 = Vector{{0}};
  scene.T = 1;
  const Result coarse = run(scene, options_for(Method::galerkin, 100));
  const Result fine = run(scene, options_to(1e-4));
  ASSERT_EQ(fine.status, Status::solved) << fine.reason;
  EXPECT_NE((coarse.warning + coarse.reason).find("x by about"), std::string::npos) << coarse.warning;
  scene.f = [](double t, Eigen::Ref<Vector> v) { v[0] = std::sin(t); };
  EXPECT_EQ(run(scene, options_for(Method::galerkin, 100)).warning, "");
}

}  // namespace
}  // namespace bromwich::tolerance_test
