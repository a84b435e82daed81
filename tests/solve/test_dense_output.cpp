// A result between its time points: against the same function y on a finer grid, and against exact solutions.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/base/interruption.hpp"
#include "core/result/slack.hpp"
#include "core/solve/dense_output.hpp"
#include "core/solve/switch_errors.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>

namespace bromwich {
namespace {

Options with_states(Index steps) {
  Options options = options_for(Method::march, steps);
  options.states = StateSelection::all;
  return options;
}

/// The same piecewise-linear y on a grid of half the step.
Result refined(const Result& result) {
  Result fine = result;
  fine.steps = 2 * result.steps;
  fine.y.resize(fine.steps + 1, result.y.cols());
  for (Index j = 0; j <= result.steps; ++j) fine.y.row(2 * j) = result.y.row(j);
  for (Index j = 0; j < result.steps; ++j) fine.y.row(2 * j + 1) = (result.y.row(j) + result.y.row(j + 1)) / 2;
  return fine;
}

// In steps without a switch.
TEST(DenseOutput, IsTheStateOfPiecewiseLinearY) {
  Scene scene = make_scene("signorini", {{"Q", 7}});
  scene.f = {};  // its samples differ between the grids
  const auto backend = make_cpu_backend(1);
  const Result result = solve(scene, *backend, with_states(20));
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  std::vector<double> times;
  std::vector<Index> steps, rows;
  for (Index j = 0; j < 20; ++j) {
    if (((result.y.row(j).array() > 0) != (result.y.row(j + 1).array() > 0)).any()) continue;
    times.push_back((double(j) + 0.5) * scene.T / 20);
    steps.push_back(j);
    rows.push_back(2 * j + 1);
  }
  ASSERT_GE(steps.size(), 3u);
  const Result between = at_times(scene, *backend, result, times);
  const Matrix known = states_at(scene, *backend, refined(result), rows);
  EXPECT_LE(distance(between.x, RowMatrix(known.transpose())), same_problem);
  for (std::size_t k = 0; k < steps.size(); ++k)
    EXPECT_LE(distance(between.y.row(Index(k)), (result.y.row(steps[k]) + result.y.row(steps[k] + 1)) / 2), 1e-15);
}

// Whether each step is solved again (the bridge) or where y may jump (M = 0).
TEST(DenseOutput, CanBeInterrupted) {
  const auto backend = make_cpu_backend(1);
  Scene jumps;  // x falls to 0 and stays there
  jumps.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1}}, Matrix{{1}}};
  jumps.M = Matrix{{0}};
  jumps.f = [](double, Eigen::Ref<Vector> f) { f[0] = -1; };
  jumps.x0 = Vector{{1}};
  jumps.T = 2;
  for (const Scene& scene : {make_scene("bridge"), jumps}) {
    const Result result = solve(scene, *backend, with_states(20));
    ASSERT_EQ(result.status, Status::solved) << result.reason;
    const std::function<bool()> at_once = [] { return true; };
    const InterruptedBy user(at_once);
    EXPECT_THROW(at_times(scene, *backend, result, {0.31 * scene.T, 0.77 * scene.T}), Interrupted);
  }
}

TEST(DenseOutput, AtTimePointsIsTheResult) {
  const Scene scene = make_scene("bridge");
  const auto backend = make_cpu_backend(1);
  const Result result = solve(scene, *backend, with_states(60));
  const Result same = at_times(scene, *backend, result, {0, result.t[17], result.t[60]});
  for (const auto& [row, j] : {std::pair<Index, Index>{0, 0}, {1, 17}, {2, 60}}) {
    EXPECT_EQ(same.y.row(row), result.y.row(j));
    EXPECT_EQ(same.x.row(row), result.x.row(j));
  }
}

TEST(DenseOutput, HasTheOrderOfTheMethod) {
  const Scene scene = make_scene("bridge");
  const auto backend = make_cpu_backend(1);
  const std::vector<double> times{1.234, 4.321, 8.765};
  std::vector<double> errors;
  for (const Index steps : {150, 600}) {
    const Result between = at_times(scene, *backend, solve(scene, *backend, with_states(steps)), times);
    double error = 0;
    Vector x(scene.states()), y(scene.constraints());
    for (Index k = 0; k < Index(times.size()); ++k) {
      scene.exact(times[std::size_t(k)], x, y);
      error = std::max(error, (between.x.row(k) - x.transpose()).cwiseAbs().maxCoeff());
    }
    errors.push_back(error);
  }
  EXPECT_LE(errors[0], 1e-2);
  EXPECT_LE(errors[1], errors[0] / 10);  // 16 if the times lie alike within their steps
}

TEST(DenseOutput, RefusesWhatItCannotKnow) {
  const Scene scene = make_scene("bridge");
  const auto backend = make_cpu_backend(1);
  const Result march = solve(scene, *backend, with_states(60));
  EXPECT_THROW(at_times(scene, *backend, march, {-1e-3}), Error);
  EXPECT_THROW(at_times(scene, *backend, march, {scene.T + 1}), Error);
  EXPECT_THROW(at_times(scene, *backend, march, {NAN}), Error);
  const std::string message = refusal([&] { at_times(scene, *backend, march, {10.0}); });
  EXPECT_EQ(message, "times: found 10; give times from 0 to T = 9.4247779607693793") << "17 digits";
}

// Rows at times that were asked for, evaluated again: polynomials are still known, steps are not.
TEST(DenseOutput, OfSampledRows) {
  const Scene scene = make_scene("bridge");
  const auto backend = make_cpu_backend(1);
  Options options = with_states(60);
  const std::vector<double> asked{1.25, 5.5, 7.75}, others{3.3, 5.5};
  const Result steps = at_times(scene, *backend, solve(scene, *backend, options), asked);
  EXPECT_EQ(refusal([&] { at_times(scene, *backend, steps, others); }),
            "result: has rows at times that were asked for, not at its steps; ask the result of the solve");
  options.method = Method::events;
  const Result located = solve(scene, *backend, options), direct = at_times(scene, *backend, located, others);
  const Result again = at_times(scene, *backend, at_times(scene, *backend, located, asked), others);
  EXPECT_LE(distance(again.x, direct.x), 1e-12);
  EXPECT_LE(distance(again.y, direct.y), 1e-12);
}

// A mass on a stop: x'' = -1 + y, 0 <= y, x >= 0, x(0) = 1/2 falls onto x = 0 at t = 1 and stays, without a bounce. y
// jumps from 0 to 1, and is an impulse in between. The fall is a parabola, which Radau IIA steps have exactly.
TEST(DenseOutput, StatesWhereYJumpsAreThoseOfAStep) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {0, 0}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.M = Matrix{{0}};
  scene.f = [](double, Eigen::Ref<Vector> f) { f << 0, -1; };
  scene.x0 = Vector{{0.5, 0}};
  scene.T = 2;
  const auto backend = make_cpu_backend(1);
  for (const StateSelection states : {StateSelection::all, StateSelection::list}) {
    Options options = options_for(Method::march, 40);
    options.states = states;
    options.components = {0};
    options.trace = true;
    const Result result = solve(scene, *backend, options);
    ASSERT_EQ(result.status, Status::solved) << result.reason;
    ASSERT_FALSE(result.continuous);
    const std::vector<double> times{0.333, 0.77, 0.5, 1.777};
    const Result between = at_times(scene, *backend, result, times);
    for (Index k = 0; k < 4; ++k) {
      const double t = times[std::size_t(k)], x = t < 1 ? 0.5 - t * t / 2 : 0;
      EXPECT_NEAR(between.x(k, 0), x, 1e-12) << t;
      EXPECT_NEAR(between.trace(k, 0), x, 1e-12) << t;
      EXPECT_NEAR(between.y(k, 0), t < 1 ? 0 : 1, 1e-9) << t;
    }
    EXPECT_EQ(slack(scene, between).col(0), between.trace.col(0)) << "w = N x";
  }
}

// x' = -x + 1 by implicit Euler: a step of length s from x_j ends at (x_j + s)/(1 + s).
TEST(DenseOutput, ImplicitEulerTakesAShorterStep) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{0}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  scene.f = [](double, Eigen::Ref<Vector> f) { f << 1; };
  scene.x0 = Vector{{3}};
  scene.T = 1;
  const auto backend = make_cpu_backend(1);
  Options options = options_for(Method::euler, 8);
  options.states = StateSelection::all;
  const Result result = solve(scene, *backend, options), between = at_times(scene, *backend, result, {0.3, 0.5});
  EXPECT_NEAR(between.x(0, 0), (result.x(2, 0) + 0.05) / 1.05, 1e-14);
  EXPECT_EQ(between.x(1, 0), result.x(4, 0));
}

// x = t - 1, w = x + y + g, g = -3 from t = 1.6 on: y = max(0, 1 - t) before and 4 - t after. Neither the switch at t =
// 1 nor the jump are points of the grid. All rules are exact for such x and y.
// A forced mass at a rigid stop: states of rows are below it by rounding, which an impulse of y could not move.
TEST(DenseOutput, GoesOnFromARigidStop) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {-4, -0.2}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.M = Matrix{{0}};
  scene.f = [](double t, Eigen::Ref<Vector> f) { f << 0, std::sin(3 * t); };
  scene.x0 = Vector{{1, 0}};
  scene.T = 10;
  std::vector<double> times;
  for (int k = 0; k < 400; ++k) times.push_back((k + 0.37) / 40);
  for (const Method method : {Method::march, Method::euler, Method::shooting}) {
    Options options = with_states(400);
    options.method = method;
    const auto backend = make_cpu_backend(1);
    const Result r = solve(scene, *backend, options), between = at_times(scene, *backend, r, times);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    ASSERT_TRUE(between.x.allFinite() && between.y.allFinite()) << to_string(method);
    EXPECT_GE(between.x.col(0).minCoeff(), -1e-12) << to_string(method);
    // A position moves within a step by h times the largest velocity, 2.3 here.
    for (Index k = 0; k < 400; ++k) EXPECT_NEAR(between.x(k, 0), r.x(k, 0), 2.3 / 40) << to_string(method) << k;
  }
}

TEST(DenseOutput, FollowsSwitchesAndJumpsInsideSteps) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{0}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  scene.f = [](double, Eigen::Ref<Vector> f) { f << 1; };
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << (t < 1.6 ? 0 : -3); };
  scene.x0 = Vector{{-1}};
  scene.T = 3;
  const auto backend = make_cpu_backend(1);
  const std::vector<double> times{0.9, 0.95, 1.1, 1.55, 1.65, 2.9};
  for (const Method method : {Method::march, Method::contour, Method::multigrid, Method::euler, Method::events})
    for (const StateSelection states : {StateSelection::all, StateSelection::none}) {
      Options options = options_for(method, 7);
      options.states = states;
      const Result between = at_times(scene, *backend, solve(scene, *backend, options), times);
      for (Index k = 0; k < Index(times.size()); ++k) {
        const double t = times[std::size_t(k)], y = t < 1.6 ? std::max(0.0, 1 - t) : 4 - t;
        EXPECT_NEAR(between.y(k, 0), y, 1e-9) << to_string(method) << " at " << t;
        const bool known = states == StateSelection::all;
        EXPECT_NEAR(known ? between.x(k, 0) : t - 1, t - 1, 1e-9) << to_string(method) << " at " << t;
      }
    }
}

// A rectifier with a capacitor, in volts, farads and ohms: C v' = y - v/R, 0 <= y, Rs y + v - u(t) >= 0.
TEST(DenseOutput, IsTheValueOfPolynomialsBetweenLocatedSwitches) {
  constexpr double R = 1e5, C = 1e-6, Rs = 10;
  auto calls = std::make_shared<long>(0);
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1 / (R * C)}}, Matrix{{1 / C}}, Matrix{{1}}};
  scene.M = Matrix{{Rs}};
  scene.g = [calls](double t, Eigen::Ref<Vector> g) { ++*calls, g << -325 * std::sin(314.159 * t); };
  scene.x0 = Vector{{0}};
  scene.T = 0.1;
  const auto backend = make_cpu_backend(1);
  const auto solved = [&](Index steps) {
    Options options = options_for(Method::events, steps);
    options.states = StateSelection::all;
    options.trace = true;
    return solve(scene, *backend, options);
  };
  const Result coarse = solved(40), fine = solved(520);
  ASSERT_EQ(coarse.status, Status::solved) << coarse.reason;
  const long before = *calls;
  const std::vector<double> times(fine.t.begin(), fine.t.end());
  const Result between = at_times(scene, *backend, coarse, times);
  const std::vector<Switch> found = switches_with_errors(scene, *backend, {}, coarse), rows = switches(coarse);
  EXPECT_EQ(*calls, before) << "nothing is solved again";
  const Matrix states = states_at(scene, *backend, coarse, {7, 23});
  const double tolerance = 2 * *coarse.error_estimate + 1e-12;
  for (const auto part : {&Solution::y, &Solution::x, &Solution::trace})
    EXPECT_LE((between.*part - fine.*part).cwiseAbs().maxCoeff(), tolerance * (fine.*part).cwiseAbs().maxCoeff());
  EXPECT_NEAR(states(0, 1), coarse.x(23, 0), 325e-12);
  ASSERT_EQ(found.size(), 10u) << "the diode conducts once a period";
  ASSERT_EQ(rows.size(), found.size());
  for (std::size_t k = 0; k < found.size(); ++k) {
    const double t = found[k].t, w = at_times(scene, *backend, coarse, {t}).x(0, 0) - 325 * std::sin(314.159 * t);
    EXPECT_LE(std::abs(w), 325 * 314.159 * found[k].error + 1e-9) << t;
    EXPECT_EQ(rows[k].t, t);
  }
}

// x jumps from -1/2 to 0 and stays: y = 2 behind an impulse of 1/2.
TEST(DenseOutput, IntegralsBeginWithTheImpulseAtZero) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{0}};
  scene.x0 = Vector{{-0.5}};
  scene.T = 1;
  scene.f = [](double, Eigen::Ref<Vector> f) { f[0] = -2; };
  const auto backend = make_cpu_backend(1);
  for (const Method method : {Method::events, Method::march, Method::euler})
    for (const double tolerance : {0.0, 1e-5}) {
      Options options = options_for(method, 40);
      options.tolerance = tolerance;
      const Result result = solve(scene, *backend, options);
      ASSERT_EQ(result.status, Status::solved) << to_string(method) << ": " << result.reason;
      const Result between = at_times(scene, *backend, result, {0, 0.1234, 0.5, 0.777, 1});
      EXPECT_EQ(integral_of_y(between)(0, 0), 0);
      for (Index k = 1; k < 5; ++k)
        EXPECT_NEAR(integral_of_y(between)(k, 0), 0.5 + 2 * between.t[k], 1e-9) << to_string(method) << ' ' << k;
    }
}

// Against the polynomials of located switches. y is Lipschitz, and the integral of order two in steps of 1/200: an
// error of y of (1/200)^2 times second derivatives, below 100.
TEST(DenseOutput, IntegralsAreThoseOfAllSteps) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  scene.x0 = Vector{{0.2}};
  scene.T = 1;
  scene.g = [](double t, Eigen::Ref<Vector> g) { g[0] = -0.3 + std::sin(9 * t); };
  const auto backend = make_cpu_backend(1);
  const std::vector<double> times = {0, 0.0012, 0.31234, 0.5, 0.6421, 1};
  Options exact = options_for(Method::events, 200);
  exact.tolerance = 1e-10;
  const RowMatrix known = integral_of_y(at_times(scene, *backend, solve(scene, *backend, exact), times));
  ASSERT_GT(known(5, 0), 0.1);
  for (const Method method : {Method::march, Method::contour, Method::galerkin, Method::euler}) {
    const Result between = at_times(scene, *backend, solve(scene, *backend, options_for(method, 200)), times);
    const double error = method == Method::euler ? 1.0 / 200 : 100.0 / (200 * 200);
    EXPECT_LE(distance(integral_of_y(between), known), error) << to_string(method);
  }
}

TEST(DenseOutput, EndsWithTheRowsThatAreValid) {
  const Scene scene = make_scene("bridge");
  const auto backend = make_cpu_backend(1);
  Result result = solve(scene, *backend, with_states(60));
  result.y.bottomRows(30).setConstant(NAN);
  const double h = scene.T / 60;
  const Result between = at_times(scene, *backend, result, {29.5 * h, 30.5 * h});
  EXPECT_TRUE(between.y.row(0).allFinite() && between.x.row(0).allFinite());
  EXPECT_TRUE(between.y.row(1).array().isNaN().all() && between.x.row(1).array().isNaN().all());
}

// A periodic filter whose second capacitor, a hundredth of the first, has an ideal diode to ground. The source jumps
// inside intervals, at times that are no nodes of the result. Its coefficients alone gave states that were off by the
// change in an interval, everywhere.
TEST(DenseOutput, KeepsStatesOfIntervalsInWhichSourcesJump) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1, 1}, {100, -200}}, Matrix{{0}, {100}}, Matrix{{0, 1}}};
  scene.M = Matrix{{0}};
  const auto pulse = [](double t) { return t >= 0.2137 && t < 0.5421 ? 3.0 : -2.0; };
  scene.f = [pulse](double t, Eigen::Ref<Vector> v) { v << pulse(t), 20 * std::sin(8 * t); };
  scene.breakpoints = {0.2137, 0.5421};
  scene.boundary = BoundaryCondition{Matrix::Identity(2, 2), -Matrix::Identity(2, 2), Vector::Zero(2)};
  scene.T = 1;
  const auto backend = make_cpu_backend(1);
  const auto solved = [&](Index steps, bool all) {
    Options options = with_states(steps);
    options.method = Method::galerkin;
    if (!all) options.states = StateSelection::list, options.components = {1};
    const Result r = solve(scene, *backend, options);
    EXPECT_EQ(r.status, Status::solved) << r.reason;
    return r;
  };
  const Result coarse = solved(100, true), fine = solved(6400, true);
  std::vector<double> nodes(coarse.t.begin(), coarse.t.end()), between;
  EXPECT_EQ(distance(at_times(scene, *backend, coarse, nodes).x, coarse.x), 0);
  std::vector<Index> rows;
  for (Index j = 16; j < 6400; j += 96) {
    between.push_back(fine.t[j]);
    rows.push_back(j);
  }
  const RowMatrix x = at_times(scene, *backend, coarse, between).x, known = fine.x(rows, Eigen::all);
  // Radau IIA and linear y: the error is h^2 |x''|, with x'' of at most |A|^2 |x| < 1e4 in the fast state outside of
  // its transients, which the march behind a node follows.
  EXPECT_LE((x - known).cwiseAbs().maxCoeff(), 0.5);
  EXPECT_LE((x - known).col(0).cwiseAbs().maxCoeff(), 5e-3);
  EXPECT_GE(x.col(1).minCoeff(), -1e-3) << "the diode holds v_2 >= 0";
  const RowMatrix listed = at_times(scene, *backend, solved(100, false), between).x;
  EXPECT_LE(distance(listed, x.col(1)), 1e-12);
}

}  // namespace
}  // namespace bromwich
