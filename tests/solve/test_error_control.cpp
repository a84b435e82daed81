// Error control: a solved result meets the tolerance, the estimate is close to the true error, and a tolerance out of
// reach is reported.

#include "core/base/error.hpp"
#include "core/catalogue/catalogue.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/error_control.hpp"
#include "files/scene_file.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <numbers>
#include <numeric>

namespace bromwich {
namespace {

TEST(IterationError, IsTheSumOfTheSweepsThatAreLeft) {
  // Changes c^k leave c^(n+1)/(1-c).
  EXPECT_NEAR(iteration_error({1, 0.5, 0.25, 0.125, 0.0625}), 0.0625, 1e-14);
  EXPECT_EQ(iteration_error({}), 0);
  EXPECT_EQ(iteration_error({1, 0}), 0);
  EXPECT_NEAR(iteration_error({1e-13, 1e-13, 1e-13}), 99e-13, 1e-14);  // no contraction: large but finite
}

// ---- scenes ----

Options options_to(double tolerance, Method method = Method::automatic) {
  Options options = options_for(method);
  options.tolerance = tolerance;
  return options;
}

/// Largest difference over t > 0, each component relative to max(max |known|, 1e-3 of the largest component). `known`
/// has `stride` times as many steps.
double relative(const RowMatrix& found, const RowMatrix& known, Index stride) {
  Vector error = Vector::Zero(found.cols()), size = error;
  for (Index j = 1; j < found.rows(); ++j) {
    const auto apart = (found.row(j) - known.row(stride * j)).cwiseAbs();
    if (!apart.allFinite()) return std::numeric_limits<double>::infinity();
    error = error.cwiseMax(apart.transpose());
    size = size.cwiseMax(known.row(stride * j).cwiseAbs().transpose());
  }
  size = size.cwiseMax(1e-3 * size.maxCoeff());
  return (error.array() > 0).select(error.cwiseQuotient(size), 0).maxCoeff();
}

RowMatrix exact_y(const Scene& scene, const Result& result) {
  RowMatrix known(result.steps + 1, scene.constraints());
  Vector x(scene.states()), y(scene.constraints());
  for (Index j = 0; j <= result.steps; ++j) {
    scene.exact(result.t[j], x, y);
    known.row(j) = y.transpose();
  }
  return known;
}

/// Error of y against the exact solution, or against eight times the steps, whose own error is at most 1/8 (first
/// order).
double true_error(const Scene& scene, const Result& result) {
  const Index J = result.steps;
  if (!scene.exact) {
    const Index stride = 8;
    return relative(result.y, solved_y(scene, result.method, stride * J), stride);
  }
  return relative(result.y, exact_y(scene, result), 1);
}

// For y smooth between few kinks, orders follow theory and the estimate is close to the error. Moving ends of a contact
// set change the error of a grid, and differences of grids, by factors of up to sqrt(2) from their trend. With an
// observed order of 1.5 instead of 2, the estimate is at most 2 (2^2 - 1)/(2^1.5 - 1) = 3.3 times the error, or half of
// it; 4 with the error of the reference.
constexpr double least_effectivity = 0.5, largest_effectivity = 4;

struct ToleranceCase {
  const char* name;
  ParameterValues parameters;
  Method method;
};

void PrintTo(const ToleranceCase& c, std::ostream* out) { *out << c.name << ' ' << to_string(c.method); }

class ReachesTheTolerance : public testing::TestWithParam<std::tuple<ToleranceCase, double>> {};

TEST_P(ReachesTheTolerance, AndSaysHowLargeTheErrorIs) {
  const auto& [chosen, tolerance] = GetParam();
  const Scene scene = make_scene(chosen.name, chosen.parameters);
  const Result result = run(scene, options_to(tolerance, chosen.method));
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  ASSERT_TRUE(result.errors && result.error_estimate);
  EXPECT_LE(*result.error_estimate, tolerance);
  EXPECT_EQ(*result.error_estimate, result.errors->total());
  EXPECT_EQ(result.errors->grids.back(), result.steps);
  EXPECT_GE(result.errors->grids.size(), 4u) << "two orders want four grids";
  const double error = true_error(scene, result);
  EXPECT_LE(error, tolerance);
  EXPECT_GE(*result.error_estimate, least_effectivity * error);
  EXPECT_LE(*result.error_estimate, largest_effectivity * error);
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
  EXPECT_LE(result.errors->states, largest_effectivity * error);
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
  for (const double s : {0x1p-40, 0x1p40}) {  // powers of two: identical rounding
    const Result other = run(scaled_scene(s), options_to(1e-4));
    ASSERT_EQ(other.status, Status::solved) << other.reason;
    EXPECT_EQ(other.errors->grids, plain.errors->grids);
    EXPECT_NEAR(*other.error_estimate, *plain.error_estimate, 1e-6 * *plain.error_estimate);
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
    EXPECT_GE(run(scene, options_to(0.5)).steps, scene.default_steps) << name;
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
    EXPECT_GE(result.steps, scene.default_steps);
    const double error = relative(result.y, exact_y(scene, result), 1);
    EXPECT_LE(error, tolerance);
    EXPECT_LE(error, std::max(1e-9, *result.error_estimate / least_effectivity));
  }
}

// ---- what ends it ----

TEST(ErrorControl, StopsAtRounding) {
  const Result result = run(make_scene("bridge"), options_to(1e-15));
  EXPECT_EQ(result.status, Status::tolerance_not_met);
  EXPECT_FALSE(result.reason.empty());
  ASSERT_TRUE(result.error_estimate);
  EXPECT_GT(*result.error_estimate, 1e-15);
  EXPECT_TRUE(result.y.allFinite()) << "the finest grid is returned";
}

TEST(ErrorControl, SaysBeforeThatNoGridWillDo) {
  // First order: 1e-9 would take 1e9 steps and more.
  const Scene scene = make_scene("dlcp-small");
  const Result result = run(scene, options_to(1e-9, Method::euler));
  EXPECT_EQ(result.status, Status::tolerance_not_met);
  EXPECT_NE(result.reason.find("steps would be needed"), std::string::npos) << result.reason;
  EXPECT_LE(result.steps, 32 * scene.default_steps);  // as soon as the order is regular
  ASSERT_TRUE(result.error_estimate);
  EXPECT_LE(*result.error_estimate, largest_effectivity * true_error(scene, result));
}

TEST(ErrorControl, StopsWhereMemoryEnds) {
  const Scene scene = make_scene("signorini", {{"Q", 15}});
  Options options = options_to(1e-6, Method::march);
  options.memory_limit = 1.5 * predicted_cost(scene, Method::march, 800, 0).bytes;  // 1600 steps take twice as much
  const Result result = run(scene, options);
  EXPECT_EQ(result.status, Status::tolerance_not_met);
  EXPECT_EQ(result.steps, 800);
  EXPECT_NE(result.reason.find("refused"), std::string::npos) << result.reason;
}

TEST(ErrorControl, IsInterrupted) {
  Options options = options_to(1e-4, Method::contour);
  options.interrupted = [] { return true; };
  EXPECT_EQ(run(make_scene("signorini", {{"Q", 15}}), options).status, Status::interrupted);
  Index sweeps = 0;  // the first grids need fewer than 40 together
  options.progress = [&sweeps](const Progress&) { ++sweeps; };
  options.interrupted = [&sweeps] { return sweeps > 20; };
  const Result later = run(make_scene("signorini", {{"Q", 15}}), options);
  EXPECT_EQ(later.status, Status::interrupted) << later.reason;
  EXPECT_TRUE(later.y.allFinite()) << "what a coarser grid found is returned";
}

TEST(ErrorControl, RefusesTolerancesThatAreNone) {
  const Scene scene = make_scene("bridge");
  for (double Options::*member : {&Options::tolerance_x, &Options::tolerance_y, &Options::absolute_tolerance}) {
    Options options = options_for(Method::automatic);
    options.*member = -1;
    EXPECT_THROW(run(scene, options), Error);
  }
  for (const double tolerance : {-1e-3, 1.0, std::nan("")}) EXPECT_THROW(run(scene, options_to(tolerance)), Error);
}

TEST(ErrorControl, StepsAreTheFirstGrid) {
  Options options = options_to(1e-3, Method::march);
  options.steps = 30;
  const Result result = run(make_scene("bridge"), options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  ASSERT_GE(result.errors->grids.size(), 3u);
  EXPECT_EQ(result.errors->grids[0], 30);
  EXPECT_EQ(result.errors->grids[1], 60);
}

// ---- coarse solutions are reused ----

TEST(FirstIterate, OfTheSolutionLeavesNothingToDo) {
  const Scene scene = make_scene("signorini", {{"Q", 15}});
  Options options = options_for(Method::contour, 200);
  const Result cold = run(scene, options);
  ASSERT_EQ(cold.status, Status::solved) << cold.reason;
  options.tuning.first_iterate = &cold.y;
  const Result warm = run(scene, options);
  ASSERT_EQ(warm.status, Status::solved) << warm.reason;
  EXPECT_LE(warm.iterations, 3);
  EXPECT_LE(distance(warm.y, cold.y), same_problem);
}

TEST(FirstIterate, IsTheCoarserGridInErrorControl) {
  const Scene scene = make_scene("signorini");
  Options options = options_to(1e-5, Method::contour);
  options.iteration_tolerance = 1e-8;
  const Result result = run(scene, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  options.tolerance = 0;
  options.steps = result.steps;
  EXPECT_LT(result.iterations, run(scene, options).iterations);
}

TEST(FirstIterate, DoesNotDecideWhichSolutionOfAZSceneIsFound) {
  const Scene scene = make_scene("dlcp-small");
  Options options = options_for(Method::contour, 100);
  const RowMatrix other = RowMatrix::Constant(101, scene.constraints(), 10);
  const Result cold = run(scene, options);
  options.tuning.first_iterate = &other;
  EXPECT_LE(distance(run(scene, options).y, cold.y), same_problem);
}

TEST(FirstIterate, OfAnotherShapeIsRefused) {
  const RowMatrix other = RowMatrix::Zero(11, 1);
  Options options = options_for(Method::contour, 100);
  options.tuning.first_iterate = &other;
  EXPECT_THROW(run(make_scene("bridge"), options), Error);
}

// ---- example files: y may jump, and there may be no solution ----

class ErrorControlOfExamples : public testing::Test {
 protected:
  void SetUp() override {
    if (!scene_files_available()) GTEST_SKIP() << "this build has no reader for scene files";
  }
  static Scene read(const std::string& name) {
    return read_scene_file(std::filesystem::path(BROMWICH_EXAMPLES) / (name + ".toml")).scene;
  }
};

TEST_F(ErrorControlOfExamples, WithoutASolutionEndAsInfeasible) {
  const Result at_once = run(read("dlcp-small-printed"), options_to(1e-4));
  EXPECT_EQ(at_once.status, Status::infeasible);
  EXPECT_EQ(at_once.errors->grids.size(), 1u) << "at t = 0 no grid changes that";
  const Scene scene = read("fold");
  const Result later = run(scene, options_to(1e-4));
  EXPECT_EQ(later.status, Status::infeasible) << later.reason;
  EXPECT_GE(later.steps, scene.default_steps);
}

TEST_F(ErrorControlOfExamples, OfDiscontinuousYControlYWhereItConverges) {
  for (const char* name : {"diode-bridge", "singular"}) {
    const Scene scene = read(name);
    const Result result = run(scene, options_to(1e-5, Method::march));
    ASSERT_EQ(result.status, Status::solved) << name << ": " << result.reason;
    EXPECT_FALSE(result.continuous);
    EXPECT_FALSE(result.errors->of_integral);
    const double error = true_error(scene, result);
    EXPECT_LE(error, 1e-5) << name;
    // Scattered estimates are at least a third of the error (tests/accuracy/test_convergence.cpp,
    // OfScatteredErrors...).
    EXPECT_GE(*result.error_estimate, error / 3) << name;
  }
}

// Perturbations grow by 1e4 here: rounding alone causes errors of 1e-6 in y. The exact solution is known.
TEST_F(ErrorControlOfExamples, CountWhatRoundingDoesToY) {
  const Scene scene = read("dlcp-small-unstable");
  for (const double tolerance : {1e-5, 1e-6}) {
    const Result result = run(scene, options_to(tolerance));
    ASSERT_TRUE(result.error_estimate) << result.reason;
    const double error = true_error(scene, result);
    EXPECT_TRUE(result.status != Status::solved || error <= tolerance) << error;
    EXPECT_GE(*result.error_estimate, 0.3 * error) << tolerance << ' ' << result.steps;
    EXPECT_GT(result.errors->rounding, 10 * result.rounding) << "y is more sensitive than x";
  }
}

// Switches of this relay keep their place within the step for several halvings, so differences of grids vanish by
// chance.
TEST_F(ErrorControlOfExamples, AreNotSolvedByChance) {
  const Scene scene = read("relay-oscillator");
  for (const Index first : {0, 82}) {
    Options options = options_to(1e-3);
    options.steps = first;
    const Result result = run(scene, options);
    ASSERT_EQ(result.status, Status::solved) << result.reason;
    EXPECT_TRUE(result.errors->of_integral) << "y jumps";
    EXPECT_GE(result.steps, scene.default_steps) << "a coarse grid does not show what jumps";
  }
}

TEST_F(ErrorControlOfExamples, OfJumpsControlTheMean) {
  for (const char* name : {"relay-sliding", "bridge-filter"}) {  // jumps; an impulse at t = 0
    const Scene scene = read(name);
    const double tolerance = 1e-3;
    const Result result = run(scene, options_to(tolerance, Method::march));
    ASSERT_EQ(result.status, Status::solved) << name << ": " << result.reason;
    EXPECT_TRUE(result.errors->of_integral) << name;
    Options fine;
    fine.method = Method::march;
    fine.steps = 8 * result.steps;
    const double error = relative(integral_of_y(result), integral_of_y(run(scene, fine)), 8);
    EXPECT_LE(error, tolerance) << name;
    EXPECT_GE(*result.error_estimate, least_effectivity * error) << name;
  }
}

// ---- causes of refusals, and of answers that cannot be certified ----

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
  ASSERT_EQ(coarse.status, Status::solved) << coarse.reason;
  const Result fine = run(scene, options_to(1e-4));
  ASSERT_EQ(fine.status, Status::solved) << fine.reason;
  EXPECT_NE(coarse.warning.find("method march"), std::string::npos) << coarse.warning;
  scene.f = [](double t, Eigen::Ref<Vector> v) { v[0] = std::sin(t); };
  EXPECT_EQ(run(scene, options_for(Method::galerkin, 100)).warning, "");
}

}  // namespace
}  // namespace bromwich
