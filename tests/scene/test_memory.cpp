// Elements with memory stated in C++: the scenes that are made of them, solves, and mistakes.

#include "core/scene/memory.hpp"

#include "core/scene/memory_rows.hpp"
#include "tests/support/memory_oracle.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace bromwich {
namespace memory_test {

TimeFunction constant(const Vector& value) {
  return [value](double, Eigen::Ref<Vector> f) { f = value; };
}

// x' = -x + 2 h: h = 1 from x < 0.9 on and 0 from x > 1.1 on.
Scene thermostat() {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix(1, 0), Matrix(0, 1)};
  scene.M = Matrix(0, 0);
  scene.x0 = Vector{{1.1}};
  scene.T = 5.5 * std::log(1.1 / 0.9);
  scene.memories = {
      {.name = "heater",
       .modes = {
           {.name = "off", .leave = {{.to = "on", .when = {Memory::below(0, 0.9, 1)}}}},
           {.name = "on", .f = constant(Vector{{2}}), .leave = {{.to = "off", .when = {Memory::above(0, 1.1, 1)}}}}}}};
  return scene;
}

Result solved(const Scene& scene) {
  Options options;
  if (scene.boundary)
    options.steps = 64;
  else
    options.tolerance_x = 1e-8;
  options.states = StateSelection::all;
  return run(scene, options);
}

double at_end(const Result& r, Index state) { return r.x(r.x.rows() - 1, state); }

TEST(Memory, AThermostat) {
  const Result r = solved(thermostat());
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NEAR(at_end(r, 0), 2 - 1.1 * std::exp(-std::log(1.1 / 0.9) / 2), 1e-9);
  ASSERT_EQ(r.mode_changes.size(), 5u);
  for (std::size_t k = 0; k < 5; ++k) {
    EXPECT_NEAR(r.mode_changes[k].t, double(k + 1) * std::log(1.1 / 0.9), 1e-10);
    EXPECT_EQ(r.mode_changes[k].to, k % 2 == 0 ? 1 : 0);
  }
}

// E x' = ... with a mass: that of the mode too.
TEST(Memory, AMassMatrix) {
  Scene scene = thermostat();
  scene.dynamics = DenseDynamics{Matrix{{-3}}, Matrix(1, 0), Matrix(0, 1), Matrix{{3}}};
  scene.memories[0].modes[1].f = {};
  scene.memories[0].modes[1].A = Matrix{{-3}};
  scene.f = constant(Vector{{6}});  // x' = 2 - x, and 2 - 2 x
  scene.memories[0].modes[0].leave[0].when = {Memory::above(0, 1.5, 1)};
  scene.memories[0].modes[1].leave[0].when = {Memory::below(0, 1.2, 1)};
  const double up = std::log(0.9 / 0.5), down = std::log(0.5 / 0.2) / 2;
  scene.T = up + down + 0.1;
  const Result r = solved(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_EQ(r.mode_changes.size(), 2u);
  EXPECT_NEAR(r.mode_changes[0].t, up, 1e-9);
  EXPECT_NEAR(r.mode_changes[1].t, up + down, 1e-9);
  EXPECT_NEAR(at_end(r, 0), 2 - 0.8 * std::exp(-0.1), 1e-9);
}

// All of A, B, N, M, f and g change: y = -(N x + g) / M where it acts, so that each mode is linear.
TEST(Memory, AllThatAModeChanges) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-0.2, 1}, {-1, -0.1}}, Matrix{{0.3}, {-0.2}}, Matrix{{0.1, -0.2}}};
  scene.M = Matrix{{2}};
  scene.f = constant(Vector{{0, -1}});
  scene.g = constant(Vector{{-4}});
  scene.x0 = Vector{{1, 0}};
  scene.T = 15;
  const Memory::Mode other{.name = "b",
                           .f = constant(Vector{{0.1, 1.8}}),
                           .g = constant(Vector{{0.5}}),
                           .A = Matrix{{-0.1, 0.5}, {0, -0.1}},
                           .B = Matrix{{0.2}, {0.1}},
                           .N = Matrix{{0.2, 0.1}},
                           .M = Matrix{{-0.5}},
                           .leave = {{.to = "a", .when = {Memory::above(0, 1, 2)}}}};
  scene.memories = {
      {.name = "m", .modes = {{.name = "a", .leave = {{.to = "b", .when = {Memory::below(0, -0.3, 2)}}}}, other}}};
  const Result r = solved(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_LE(r.residual, 1e-12);
  // z = (x, 1).
  const auto mode = [](const Matrix& A, const Vector& B, const Vector& N, double M, const Vector& f, double g) {
    Matrix all = Matrix::Zero(3, 3);
    all.topLeftCorner(2, 2) = A - B * N.transpose() / M;
    all.topRightCorner(2, 1) = f - B * g / M;
    return all;
  };
  const std::vector<OracleMode> modes{
      {mode(Matrix{{-0.2, 1}, {-1, -0.1}}, Vector{{0.3, -0.2}}, Vector{{0.1, -0.2}}, 2, Vector{{0, -1}}, -4),
       {{Vector{{-1, 0, -0.3}}, 1}}},
      {mode(Matrix{{-0.3, 1.5}, {-1, -0.2}}, Vector{{0.5, -0.1}}, Vector{{0.3, -0.1}}, 1.5, Vector{{0.1, 0.8}}, -3.5),
       {{Vector{{1, 0, -1}}, 0}}}};
  const OracleRun known = run_of_modes(modes, 0, Vector{{1, 0, 1}}, 15);
  ASSERT_GE(known.times.size(), 6u);
  ASSERT_EQ(r.mode_changes.size(), known.times.size());
  for (std::size_t k = 0; k < known.times.size(); ++k) EXPECT_NEAR(r.mode_changes[k].t, known.times[k], 1e-8);
  for (Index i = 0; i < 2; ++i) EXPECT_NEAR(at_end(r, i), known.z[i], 1e-8);
}

// A coil between voltages a (on) and -b (off), on by a clock of period 1 and off at i = 1: i(0) = 1 - a b / (a + b),
// and a change of i(0) comes back times -b/a.
TEST(Memory, PeriodicStatesByShooting) {
  constexpr double a = 1.4, b = 1;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0}}, Matrix(1, 0), Matrix(0, 1)};
  scene.M = Matrix(0, 0);
  scene.boundary = BoundaryCondition{Matrix{{1}}, Matrix{{-1}}, Vector::Zero(1)};
  scene.T = 1;
  scene.breakpoints = {0.01};
  scene.breakpoints_are_all = true;
  const TimeFunction clock = [](double t, Eigen::Ref<Vector> e) { e[0] = t < 0.01 ? 1 : -1; };
  for (const char* start : {"on", "off"}) {
    scene.memories = {
        {.name = "switch",
         .modes = {{.name = "off", .f = constant(Vector{{-b}}), .leave = {{"on", {{.time = clock}}}}},
                   {.name = "on", .f = constant(Vector{{a}}), .leave = {{"off", {Memory::above(0, 1, 1)}}}}},
         .start = start}};
    const Result r = solved(scene);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_EQ(r.method, Method::shooting);
    ASSERT_EQ(r.start.size(), 1);
    EXPECT_NEAR(r.start[0], 1 - a * b / (a + b), 1e-9);
    ASSERT_EQ(r.multipliers.size(), 1u);
    EXPECT_NEAR(r.multipliers[0].real(), -b / a, 1e-9);
  }
}

// x' = 1 from 0, and to 0 where it comes to 0.75: a mode that follows itself.
TEST(Memory, StatesThatAreSet) {
  Scene scene = thermostat();
  scene.dynamics = DenseDynamics{Matrix{{0}}, Matrix(1, 0), Matrix(0, 1)};
  scene.x0 = Vector{{0}};
  scene.f = constant(Vector{{1}});
  scene.T = 2;
  scene.memories = {
      {.name = "cell", .modes = {{.name = "rises", .leave = {{"rises", {Memory::above(0, 0.75, 1)}, {{0, 0}}}}}}}};
  const Result r = solved(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NEAR(at_end(r, 0), 0.5, 1e-9);
  EXPECT_FALSE(r.continuous);
}

// What scenes in modes have as f and g: a sum of matrices times functions, as shapes times functions of time.
TEST(Memory, SumsOfSources) {
  const TimeFunction line = LinearSource{[](double t, Eigen::Ref<Vector> v) { v << t, 1; }},
                     bent = [](double t, Eigen::Ref<Vector> v) { v[0] = t * t; },
                     shapes = SeparableSource{Matrix{{1, 2}, {3, 4}, {5, 6}}, line};
  EXPECT_FALSE(sum_of({{Matrix::Identity(2, 2), {}}}));
  const TimeFunction all =
      sum_of({{Matrix{{1, 0, 2}, {0, 1, 0}}, shapes}, {Matrix{{0}, {7}}, bent}, {Matrix{{1, 1}, {0, 1}}, line}});
  ASSERT_NE(all.separable(), nullptr);
  Vector value(2);
  for (const double t : {0.0, 0.3, 2.0}) {
    all(t, value);
    // (1, 2; 3, 4; 5, 6) (t, 1), its first row and twice its third one, its second one.
    EXPECT_DOUBLE_EQ(value[0], (t + 2) + 2 * (5 * t + 6) + (t + 1));
    EXPECT_DOUBLE_EQ(value[1], (3 * t + 4) + 7 * t * t + 1);
  }
  EXPECT_FALSE(all.linear());
  EXPECT_TRUE(sum_of({{Matrix::Identity(3, 3), shapes}, {Vector::Ones(3), one_at_all_times()}}).linear());
}

// A mode whose conditions hold at t = 0 is left at once.
TEST(Memory, BeginsInTheModeThatConditionsAskFor) {
  Scene scene = thermostat();
  scene.x0 = Vector{{0.5}};
  scene.T = 0.2;
  const Result r = solved(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NEAR(at_end(r, 0), 2 - 1.5 * std::exp(-0.2), 1e-9);
}

// A lamp that is lit while the heater is on: its conditions see the mode of the other memory alone.
TEST(Memory, ConditionsSeeModes) {
  Scene scene = thermostat();
  const auto less_half = [](double sign) -> TimeFunction { return constant(Vector{{-sign / 2}}); };
  scene.memories.push_back(
      {.name = "lamp",
       .modes = {{.name = "dark", .leave = {{"lit", {{.x = Vector{{0, 1, 0}}, .time = less_half(1)}}}}},
                 {.name = "lit", .leave = {{"dark", {{.x = Vector{{0, -1, 0}}, .time = less_half(-1)}}}}}}});
  const Result r = solved(scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_EQ(r.mode_changes.size(), 10u);
  for (std::size_t k = 0; k < 10; ++k) {
    EXPECT_NEAR(r.mode_changes[k].t, double(k / 2 + 1) * std::log(1.1 / 0.9), 1e-10);
    EXPECT_EQ(r.mode_changes[k].memory, Index(k % 2));
    EXPECT_EQ(r.mode_changes[k].to, k / 2 % 2 == 0 ? 1 : 0);
  }
}

TEST(Memory, OtherMethodsRefuse) {
  for (const Method method : {Method::march, Method::euler, Method::galerkin, Method::goal}) {
    const Result r = run(thermostat(), options_for(method, 10));
    EXPECT_EQ(r.status, Status::unsupported) << to_string(method);
    EXPECT_NE(r.reason.find("modes with memory"), std::string::npos) << r.reason;
  }
}

TEST(Memory, ModesThatChangeWithoutEndAreNamed) {
  Scene scene = thermostat();
  scene.memories[0].modes[0].leave[0].when = {Memory::below(0, 1, 1)};
  scene.memories[0].modes[1].leave[0].when = {Memory::above(0, 1, 1)};  // no hysteresis: x stays at 1
  EXPECT_EQ(solved(scene).status, Status::tolerance_not_met);
}

TEST(Memory, MistakesAreNamed) {
  const auto message = [](const std::function<void(Scene&)>& change) {
    Scene scene = thermostat();
    change(scene);
    return refusal([&] { scene.validate(); });
  };
  const auto expect = [](const std::string& found, const std::string& known) {
    EXPECT_TRUE(found.starts_with(known)) << found;
  };
  EXPECT_EQ(message([](Scene&) {}), "nothing was refused");
  expect(message([](Scene& s) { s.memories[0].name.clear(); }), "memories[0].name: found ''");
  expect(message([](Scene& s) { s.memories.push_back(s.memories[0]); }), "memories[1].name: found 'heater'");
  expect(message([](Scene& s) { s.memories[0].start = "warm"; }),
         "memories[0].start: found 'warm'; the modes of heater are off, on");
  expect(message([](Scene& s) { s.memories[0].modes.clear(); }), "memories[0].modes: has no mode");
  expect(message([](Scene& s) { s.memories[0].modes[1].name = "off"; }), "memories[0].modes[1].name: found 'off'");
  expect(message([](Scene& s) { s.memories[0].modes[0].leave[0].to = "x"; }),
         "memories[0].modes[0].leave[0].to: found 'x'");
  expect(message([](Scene& s) { s.memories[0].modes[0].leave[0].when.clear(); }),
         "memories[0].modes[0].leave[0].when: has no");
  expect(message([](Scene& s) {
           s.memories[0].modes[0].leave[0].when[0].x = Vector{{1, 2, 3}};
         }),
         "memories[0].modes[0].leave[0].when.x: has 3");
  expect(message([](Scene& s) {
           s.memories[0].modes[0].leave[0].set = {{1, 0}};
         }),
         "memories[0].modes[0].leave[0].set: sets");
  expect(message([](Scene& s) { s.memories[0].modes[0].A = Matrix{{1, 2}}; }), "memories[0].modes[0].A: is 1 x 2");
  expect(message([](Scene& s) { s.memories[0].modes[0].f = constant(Vector{{NAN}}); }), "memories[0].modes[0].f(0)");
  expect(message([](Scene& s) {
           s.dynamics = SparseDynamics{SparseMatrix(1, 1), SparseMatrix(1, 0), SparseMatrix(0, 1)};
         }),
         "memories: need dense dynamics");
}

}  // namespace memory_test
}  // namespace bromwich
