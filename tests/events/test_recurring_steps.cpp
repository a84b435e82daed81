// Steps that recur with periodic sources, against closed forms.

#include "core/events/event_driven.hpp"
#include "core/events/event_sources.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace bromwich {
namespace recurring_steps_test {

constexpr int periods = 60;

// 1 in the first half of each period of length 2, and -1 in the second one.
double square(double t) { return std::fmod(t, 2) < 1 ? 1 : -1; }

std::vector<double> edges() {
  std::vector<double> times;
  for (int k = 1; k < 2 * periods; ++k) times.push_back(k);
  return times;
}

// x' = -x + y + square, 0 <= y, w = x + y/10 >= 0: y = -10 x where x < 0.
Scene diode(const TimeFunction& f) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{0.1}};
  scene.f = f;
  scene.x0 = Vector{{0.3}};
  scene.T = 2 * periods;
  return scene;
}

// The state of the diode at the ends of half periods.
std::vector<double> known_states() {
  std::vector<double> states{0.3};
  const auto moved = [](double x, double f, double rate, double t) {
    return f / rate + (x - f / rate) * std::exp(-rate * t);
  };
  for (int k = 0; k < 2 * periods; ++k) {
    const double f = k % 2 == 0 ? 1 : -1, x = states.back();
    double t = 0;
    if (x != 0 && (x > 0) != (f > 0)) {  // to zero first
      const double rate = x < 0 ? 11 : 1;
      t = std::log(1 - x * rate / f) / rate;
    }
    states.push_back(t > 0 ? moved(0, f, f > 0 ? 1 : 11, 1 - t) : moved(x, f, x > 0 ? 1 : 11, 1));
  }
  return states;
}

TEST(RecurringSteps, AgreeWithExponentials) {
  const std::vector<double> known = known_states();
  long plain = 0, lines = 0;
  for (long* evaluations : {&plain, &lines}) {
    const TimeFunction f = [evaluations](double t, Eigen::Ref<Vector> value) {
      ++*evaluations;
      value[0] = square(t);
    };
    const Scene scene = diode(evaluations == &lines ? TimeFunction(LinearSource{f}) : f);
    const EventSolution s = integrate_with_events(scene, LcpClass::P, edges(), {});
    ASSERT_TRUE(s.complete) << s.reason;
    for (int k = 1; k <= 2 * periods; ++k) EXPECT_NEAR(s.x(k, true)[0], known[std::size_t(k)], 1e-9) << k;
  }
  EXPECT_LT(3 * lines, plain);  // a step takes 2 values of a line, and 11 and more of another function
}

// x' = -x + y_0 + y_1, w_0 = w_1 = x + y_0 + y_1 + g with g = -1 in the first half of each period, and 1 in the second:
// y_0 + y_1 = 1 - x or 0. The share of both is that of least norm in every period.
TEST(RecurringSteps, YKeepsItsLeastNorm) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1, 1}}, Matrix{{1}, {1}}};
  scene.M = Matrix(Matrix::Ones(2, 2));
  scene.g = LinearSource{[](double t, Eigen::Ref<Vector> v) { v.setConstant(-square(t)); }};
  scene.x0 = Vector::Zero(1);
  scene.T = 2 * periods;
  const EventSolution s = integrate_with_events(scene, LcpClass::PSD, edges(), {});
  ASSERT_TRUE(s.complete) << s.reason;
  double x = 0;
  for (int k = 0; k < periods; ++k) {
    const double middle = 0.5 + (x - 0.5) * std::exp(-1.0);  // x' = 1 - 2 x
    const Vector y = s.y(2 * k + 0.5, true), off = s.y(2 * k + 1.5, true);
    EXPECT_NEAR(y[0], (1 - middle) / 2, 1e-9) << k;
    EXPECT_NEAR(y[1], y[0], 1e-12) << k;
    EXPECT_EQ(off.cwiseAbs().maxCoeff(), 0) << k;
    x = (0.5 + (x - 0.5) * std::exp(-2.0)) * std::exp(-1.0);
  }
}

// Sources that are lines with a slope: x' = -x + t - k in the half period k.
TEST(RecurringSteps, Ramps) {
  const TimeFunction ramp = [](double t, Eigen::Ref<Vector> value) { value[0] = t - std::floor(t); };
  Scene scene = diode(LinearSource{ramp});
  const EventSolution s = integrate_with_events(scene, LcpClass::P, edges(), {});
  ASSERT_TRUE(s.complete) << s.reason;
  double x = 0.3;
  for (int k = 0; k < 2 * periods; ++k) {
    EXPECT_NEAR(s.x(k + 0.25, true)[0], (x + 1) * std::exp(-0.25) - 0.75, 1e-9) << k;
    x = (x + 1) * std::exp(-1.0);
    EXPECT_NEAR(s.x(k + 1, true)[0], x, 1e-9) << k;
  }
}

// Over lines steps may be as long as these; another integration has others.
TEST(RecurringSteps, AreAsLongAsLines) {
  const TimeFunction f = [](double t, Eigen::Ref<Vector> value) { value[0] = square(t); };
  Scene bends = diode(f), lines = diode(LinearSource{f});
  bends.T = lines.T = 2;
  EXPECT_EQ(longest_step(bends, {1}, 1), 2.0 / 48);
  EXPECT_EQ(longest_step(lines, {1}, 1), 1);
  EXPECT_LT(longest_step(lines, {1}, 2), 1);
  EventOptions options;
  options.longest_step = longest_step(lines, {1}, 1);
  const EventSolution s = integrate_with_events(lines, LcpClass::P, {1}, options);
  ASSERT_TRUE(s.complete) << s.reason;
  EXPECT_LT(s.pieces.size(), 48);
  const std::vector<double> known = known_states();
  for (const std::size_t k : {1, 2}) EXPECT_NEAR(s.x(double(k), true)[0], known[k], 1e-9) << k;
}

// A state that follows the square within 1e-5: steps behind an edge begin as long as those behind the edge before could
// be. An attempt takes two values of a line; a quarter of the attempts may be in vain, which are those behind the first
// edges and where steps have grown too much. Steps that begin as long as the one before the edge take six more each.
TEST(RecurringSteps, BeginAsLongAsTheyDidBefore) {
  constexpr double rate = 1e5;
  long evaluations = 0;
  const TimeFunction f = [&evaluations](double t, Eigen::Ref<Vector> value) {
    ++evaluations;
    value << square(t), rate * square(t);
  };
  Scene scene = diode(LinearSource{f});
  scene.dynamics = DenseDynamics{Matrix{{-1, 0}, {0, -rate}}, Matrix{{1}, {0}}, Matrix{{1, 0}}};
  scene.x0 = Vector{{0.3, 0}};
  const EventSolution s = integrate_with_events(scene, LcpClass::P, edges(), {});
  ASSERT_TRUE(s.complete) << s.reason;
  EXPECT_LT(double(evaluations), 1.25 * 2 * double(s.pieces.size()));
  const std::vector<double> known = known_states();
  for (int k = 1; k <= 2 * periods; ++k) {
    EXPECT_NEAR(s.x(k, true)[0], known[std::size_t(k)], 1e-9) << k;
    EXPECT_NEAR(s.x(k, true)[1], k % 2 == 1 ? 1 : -1, 1e-9) << k;
  }
}

// The budget is asked with what is spent, and ends the integration.
TEST(RecurringSteps, AskWhatTheyMaySpend) {
  const Scene scene = diode([](double t, Eigen::Ref<Vector> value) { value[0] = square(t); });
  EventOptions options;
  std::vector<double> spent;
  options.budget = [&spent](double work, double) {
    spent.push_back(work);
    return spent.size() < 4 ? 2 * work + 1e4 : work;
  };
  const EventSolution ended = integrate_with_events(scene, LcpClass::P, edges(), options);
  EXPECT_FALSE(ended.complete);
  EXPECT_EQ(ended.end, EventEnd::out_of_work);
  ASSERT_EQ(spent.size(), 4);
  for (std::size_t k = 1; k < 4; ++k) EXPECT_GE(spent[k], 2 * spent[k - 1] + 1e4);
  options.budget = [](double work, double) { return 2 * work + 1e4; };
  EXPECT_TRUE(integrate_with_events(scene, LcpClass::P, edges(), options).complete);
}

}  // namespace recurring_steps_test
}  // namespace bromwich
