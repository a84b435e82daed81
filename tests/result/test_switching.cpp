// Switching times between grid points, against exact solutions.

#include "catalogue/catalogue.hpp"
#include "core/result/switching.hpp"
#include "core/solve/switch_errors.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

Result rows_of(const std::vector<double>& y, double h = 1) {
  Result result;
  result.steps = Index(y.size()) - 1;
  result.t = Vector::LinSpaced(Index(y.size()), 0, h * double(result.steps));
  result.y = Eigen::Map<const RowMatrix>(y.data(), Index(y.size()), 1);
  return result;
}

TEST(Switches, OfStraightLinesAreExact) {
  // Zero until 2.25, slope 2 up to 5, slope -4 down to 0 at 6.375.
  const auto found = switches(rows_of({0, 0, 0, 1.5, 3.5, 5.5, 1.5, 0, 0}));
  ASSERT_EQ(found.size(), 2u);
  EXPECT_TRUE(found[0].on);
  EXPECT_NEAR(found[0].t, 2.25, 1e-14);
  EXPECT_NEAR(found[0].error, 0, 1e-14);
  EXPECT_FALSE(found[1].on);
  EXPECT_NEAR(found[1].t, 6.375, 1e-14);
}

TEST(Switches, AreNoneWithoutConstraints) {
  Result r;
  r.t = Vector::LinSpaced(5, 0, 1);
  r.steps = 4;
  r.y = RowMatrix(5, 0);
  EXPECT_TRUE(switches(r).empty());
}

TEST(Switches, WhereOnlyTheStepIsKnownAreItsMiddle) {
  for (const std::vector<double>& y : {std::vector<double>{0, 0, 3, 0, 0}, {0, 0, 1, 1, 1}, {0, 0, 2, 1, 1}}) {
    const auto found = switches(rows_of(y, 0.5));
    ASSERT_FALSE(found.empty());
    EXPECT_TRUE(found[0].on);
    EXPECT_EQ(found[0].t, 0.75);
    EXPECT_EQ(found[0].error, 0.25);
  }
}

TEST(Switches, DoNotCountRoundingOrRowsThatAreNotValid) {
  EXPECT_TRUE(switches(rows_of({1, 1e-17, 1})).size() == 2u);
  EXPECT_TRUE(switches(rows_of({0, 1e-17, 0, 1, 1, 1})).size() == 1u);
  EXPECT_TRUE(switches(rows_of({0, 0, NAN, 1, 0})).empty());
  EXPECT_TRUE(switches(rows_of({NAN, 1, 1})).empty()) << "y at 0 need not be known";
  EXPECT_TRUE(switches(rows_of({1})).empty());
  EXPECT_TRUE(switches(rows_of({})).empty());
}

struct Known {
  double t;
  Index component;
  bool on;
};

// y1 = max(sin 3 pi t, 0)/2, y3 = max(-sin 3 pi t - 0.3, 0)/4.
std::vector<Known> switches_of_dlcp_small() {
  const double pi = std::numbers::pi, a = std::asin(0.3);
  return {{1. / 3, 1, false}, {(pi + a) / (3 * pi), 3, true}, {(2 * pi - a) / (3 * pi), 3, false}, {2. / 3, 1, true}};
}

double largest_error(Index steps) {
  const std::vector<Known> known = switches_of_dlcp_small();
  const Result result = run(make_scene("dlcp-small"), Method::march, steps);
  EXPECT_EQ(result.status, Status::solved) << result.reason;
  std::vector<Switch> found = switches(result);
  std::erase_if(found, [](const Switch& s) { return s.t < 0.01 || s.t > 0.99; });  // sin is 0 at both ends
  EXPECT_EQ(found.size(), known.size());
  double largest = 0;
  for (std::size_t k = 0; k < std::min(found.size(), known.size()); ++k) {
    EXPECT_EQ(found[k].component, known[k].component);
    EXPECT_EQ(found[k].on, known[k].on);
    const double error = std::abs(found[k].t - known[k].t);
    // The estimate omits third differences (a tenth of the second at these steps) and the error of y, of the same
    // order.
    EXPECT_LE(error, 3 * found[k].error + 1e-2 * result.t[1]);
    largest = std::max(largest, error);
  }
  return largest;
}

TEST(Switches, AreOfSecondOrder) {
  const double coarse = largest_error(110), fine = largest_error(440);
  EXPECT_LE(coarse, 0.1 / 110) << "far within a step";
  EXPECT_LE(fine, coarse / 6);  // 16 at equal positions within the step; the remainder varies
}

// Against known switches: the reported errors are upper bounds.
void expect_errors_hold(const Scene& scene, Method method, Index steps, const std::vector<Known>& known, double from,
                        double to) {
  const auto backend = make_cpu_backend(1);
  const Options options = options_for(method, steps);
  const Result result = solve(scene, *backend, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  std::vector<Switch> found = switches_with_errors(scene, *backend, options, result);
  std::erase_if(found, [&](const Switch& s) { return s.t < from || s.t > to; });
  ASSERT_EQ(found.size(), known.size()) << to_string(result.method) << ' ' << steps;
  for (std::size_t k = 0; k < found.size(); ++k) {
    EXPECT_EQ(found[k].component, known[k].component);
    EXPECT_LE(std::abs(found[k].t - known[k].t), found[k].error + 1e-12)
        << to_string(result.method) << ' ' << steps << ' ' << k;
    EXPECT_LE(found[k].error, 5 * result.t[1]) << "and not useless";
  }
}

TEST(Switches, KnowTheirErrors) {
  for (const Index steps : {50, 110, 237, 440, 1000})
    for (const Method method : {Method::march, Method::contour, Method::euler})
      expect_errors_hold(make_scene("dlcp-small"), method, steps, switches_of_dlcp_small(),
                         std::max(0.01, 1.5 / double(steps)), 1 - std::max(0.01, 1.5 / double(steps)));
}

// x' = -x + cos t with w = x + 0.1 y >= 0: y keeps x near 0. Until the first contact x is known.
TEST(Switches, KnowThatTheSolutionItselfIsOff) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.f = [](double t, Eigen::Ref<Vector> f) { f[0] = std::cos(t); };
  scene.M = Matrix{{0.1}};
  scene.x0 = Vector{{0}};
  scene.T = 4;
  // x = (cos t + sin t - e^{-t})/2 vanishes where cos t + sin t = e^{-t}.
  double t = 2.3;
  for (int k = 0; k < 50; ++k)
    t -= (std::cos(t) + std::sin(t) - std::exp(-t)) / (std::cos(t) - std::sin(t) + std::exp(-t));
  for (const Index steps : {16, 40, 100, 333})
    for (const Method method : {Method::march, Method::euler})
      expect_errors_hold(scene, method, steps, {{t, 0, true}}, 0.5, 3.9);
}

// w = y - sin 40 t with y = sin 40 t where that is positive: switches at k pi/40, several within a step of the rows.
TEST(Switches, OfLocatedEventsDoNotDependOnTheRows) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{0}}};
  scene.g = [](double t, Eigen::Ref<Vector> g) { g[0] = -std::sin(40 * t); };
  scene.M = Matrix{{1}};
  scene.x0 = Vector{{0}};
  scene.T = 1;
  const auto backend = make_cpu_backend(1);
  for (const Index steps : {4, 100}) {
    const Options options = options_for(Method::events, steps);
    const Result result = solve(scene, *backend, options);
    ASSERT_EQ(result.status, Status::solved) << result.reason;
    const std::vector<Switch> found = switches_with_errors(scene, *backend, options, result);
    ASSERT_EQ(found.size(), 13u);  // 0, pi/40, ..., 12 pi/40 < 1
    for (std::size_t k = 0; k < found.size(); ++k) {
      EXPECT_EQ(found[k].on, k % 2 == 0);
      EXPECT_LE(std::abs(found[k].t - double(k) * std::numbers::pi / 40), found[k].error);
      EXPECT_LE(found[k].error, 1e-9);
    }
  }
}

// x' = -sgn(x - 1/2 sin 3 t) with x(0) = 0: x = t stays below the sine until 2 t = sin 3 t, slides on it until
// 3/2 cos 3 t = -1, and is above it from then on.
TEST(Switches, OfARelayByLocatedEvents) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{-2, 0}}, Matrix{{-1}, {0}}};
  scene.f = [](double, Eigen::Ref<Vector> f) { f[0] = 1; };
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << std::sin(3 * t) / 2, 1; };
  scene.M = Matrix{{0, 1}, {-1, 0}};
  scene.x0 = Vector{{0}};
  scene.T = 1;
  scene.relays = 1;
  const auto backend = make_cpu_backend(1);
  const Options options = options_for(Method::events, 5);
  const Result result = solve(scene, *backend, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  const std::vector<Switch> found = switches_with_errors(scene, *backend, options, result);
  const std::vector<RelaySwitch> relay = relay_switches(result, found, 1);
  double meets = 0.5;
  for (int k = 0; k < 20; ++k) meets -= (2 * meets - std::sin(3 * meets)) / (2 - 3 * std::cos(3 * meets));
  ASSERT_GE(relay.size(), 2u);
  const RelaySwitch &first = relay[relay.size() - 2], &last = relay.back();
  EXPECT_EQ(first.to, 0);
  EXPECT_EQ(last.from, 0);
  EXPECT_LE(std::abs(first.t - meets), 1e-9);
  EXPECT_LE(std::abs(last.t - std::acos(-2.0 / 3) / 3), 1e-9);
  EXPECT_LE(std::max(first.error, last.error), 1e-8);
}

// lambda of one relay: 1, then -1 at 2 (s and y+ switch in the same step), sliding from 5, 1 again from 8.
TEST(Switches, OfRelaysAreThoseOfLambda) {
  Result result = rows_of({0, 0, 0, 1, 1, 1, .6, .4, .2, 0, 0});
  result.y.conservativeResize(11, 2);
  result.y.col(1) << 0, 0, 0, 2, 2, 1, 0, 0, 0, 0, 0;
  const std::vector<RelaySwitch> found = relay_switches(result, switches(result), 1);
  ASSERT_EQ(found.size(), 3u);
  EXPECT_EQ(found[0].from, 1);
  EXPECT_EQ(found[0].to, -1);
  EXPECT_NEAR(found[0].t, 2.5, 0.5);
  EXPECT_LE(std::abs(found[0].t - 2.5), found[0].error + 1e-12);
  EXPECT_EQ(found[1].from, -1);
  EXPECT_EQ(found[1].to, 0);
  EXPECT_NEAR(found[1].t, 6, 1e-12) << "the line of y+ ends there";
  EXPECT_EQ(found[2].to, 1);
  EXPECT_NEAR(found[2].t, 9, 1e-12);
}

TEST(Switches, OfRelaysThatNeverSwitchOrAreOfOthers) {
  Result result = rows_of({1, 1, 1, 1});  // relay 0 stays at -1, relay 1 leaves sliding for 1
  result.y.conservativeResize(4, 4);
  result.y.col(1) << .5, .3, 0, 0;
  result.y.col(2) << 3, 3, 3, 3;
  result.y.col(3).setZero();
  const std::vector<RelaySwitch> found = relay_switches(result, switches(result), 2);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].relay, 1);
  EXPECT_EQ(found[0].from, 0);
  EXPECT_EQ(found[0].to, 1);
}

}  // namespace
}  // namespace bromwich
