// Event location: nodes at the switches of active sets.

#include "catalogue/catalogue.hpp"
#include "core/galerkin/location.hpp"
#include "core/galerkin/recovery.hpp"
#include "core/result/switching.hpp"
#include "core/solve/dense_output.hpp"
#include "core/solve/switch_errors.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>

namespace bromwich {
namespace {

using reference::pi;

/// Errors against Scene::exact: y in L2 over [0, T], by Gauss points on 32 pieces of each interval (kinks lie
/// anywhere), and x at T.
struct LocationErrors {
  double y = 0, x_end = 0;
};

LocationErrors location_errors(const Scene& scene, const Result& r) {
  constexpr int pieces = 32;
  const double offset = 0.5 / std::sqrt(3.);
  LocationErrors e;
  Vector x(scene.states()), y(scene.constraints());
  for (Index k = 0; k < r.steps; ++k) {
    const double h = r.t[k + 1] - r.t[k];
    for (int piece = 0; piece < pieces; ++piece)
      for (const double s : {(piece + 0.5 - offset) / pieces, (piece + 0.5 + offset) / pieces}) {
        scene.exact(r.t[k] + s * h, x, y);
        e.y += h / (2 * pieces) * ((1 - s) * r.y_left.row(k) + s * r.y.row(k + 1) - y.transpose()).squaredNorm();
      }
  }
  scene.exact(scene.T * (1 - epsilon), x, y);
  e.x_end = (r.x.row(r.steps) - x.transpose()).norm();
  e.y = std::sqrt(e.y);
  return e;
}

Result run_located(const Scene& scene, Index steps, bool located) {
  Options options = options_for(Method::galerkin, steps);
  options.states = StateSelection::all;
  options.event_location = located;
  const Result r = run(scene, options);
  EXPECT_EQ(r.status, Status::solved) << scene.name << ": " << r.reason;
  return r;
}

double location_order(double coarse, double fine, Index N, Index M) {
  return std::log(coarse / fine) / std::log(double(M) / double(N));
}

// The kinks at pi/2, 3 pi/2 and 2 pi lie at different places in their intervals: 6 does not divide N.
TEST(GalerkinLocation, BridgeHasTheErrorsOfAGridWithItsKinksOnNodes) {
  const Scene scene = make_scene("bridge", {});
  std::vector<LocationErrors> errors;
  const std::array<Index, 3> grids{110, 230, 470};
  for (const Index N : grids) {
    const Result r = run_located(scene, N, true);
    EXPECT_NEAR(double(r.steps), double(N), 3);
    EXPECT_EQ(r.warning, "");
    EXPECT_NE(r.kernel.find("4 switches on nodes"), std::string::npos) << r.kernel;
    // The slope of y changes by its second derivative, about 4, within an interval.
    for (const double kink : {pi / 2, 1.5 * pi, 2 * pi})
      EXPECT_LE((r.t.array() - kink).abs().minCoeff(), 4 * std::pow(scene.T / double(N), 2)) << N;
    errors.push_back(location_errors(scene, r));
  }
  for (std::size_t i = 1; i < errors.size(); ++i) {
    EXPECT_GE(location_order(errors[i - 1].y, errors[i].y, grids[i - 1], grids[i]), 1.9);
    EXPECT_GE(location_order(errors[i - 1].x_end, errors[i].x_end, grids[i - 1], grids[i]), 1.9);
  }
  const LocationErrors on_nodes = location_errors(scene, run_located(scene, 468, false));
  EXPECT_NEAR(errors.back().y / on_nodes.y, 1, 0.05);
  EXPECT_LE(errors.back().x_end, 0.05 * location_errors(scene, run_located(scene, 470, false)).x_end);
}

// In both scenes y is linear between its kinks, with slopes up to 13. The remaining error comes from two kinks whose
// nodes are off by the accuracy of the location, d = 0.1 T/N^2: slope d^1.5 each.
TEST(GalerkinLocation, BoundaryProblems) {
  const Index N = 149;
  for (const char* name : {"nash-game", "lq-control"}) {
    const Scene scene = make_scene(name, {});
    const double located = location_errors(scene, run_located(scene, N, true)).y;
    EXPECT_LE(located, 2 * 13 * std::pow(0.1 / double(N * N), 1.5)) << name;
    EXPECT_LE(located, 1e-3 * location_errors(scene, run_located(scene, N, false)).y) << name;
  }
}

TEST(GalerkinLocation, SwitchesAndOutputOfALocatedResult) {
  const Scene scene = make_scene("bridge", {});
  const Result r = run_located(scene, 230, true);
  const double h = scene.T / 230;
  std::vector<Switch> found = switches(r);
  ASSERT_EQ(found.size(), 4u);  // the last one at T
  const std::array<double, 4> known{pi / 2, 1.5 * pi, 2 * pi, 3 * pi};
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(found[i].t, known[i], 4 * h * h) << i;
  const auto backend = make_cpu_backend(1);
  const std::vector<double> times{0, 0.3, pi / 2, 4, 5.55, r.t[100], scene.T};
  const Result sampled = at_times(scene, *backend, r, times);
  Vector x(2), y(1);
  for (std::size_t i = 0; i < times.size(); ++i) {
    scene.exact(times[i], x, y);
    EXPECT_LE((sampled.x.row(Index(i)) - x.transpose()).norm(), 1e-4) << times[i];
  }
  EXPECT_LE((sampled.x.row(5) - r.x.row(100)).norm(), 8 * epsilon * r.x.row(100).norm());
}

// x' = -x + y + f, w = x + y - s(t): if s = 1 from t = 0.43 on, y jumps by 1, and no linear function leads to the jump.
TEST(GalerkinLocation, SaysWhatItDoesNotLocate) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << (t < 0.43 ? 1 : -1); };
  scene.x0 = Vector{{0}};
  const Result r = run_located(scene, 20, true);
  EXPECT_NE(r.warning.find("1 switch"), std::string::npos) << r.warning;
}

TEST(GalerkinLocation, Refusals) {
  const Scene scene = make_scene("bridge", {});
  Options options = options_for(Method::march, 20);
  options.event_location = true;
  EXPECT_EQ(refusal([&] { run(scene, options); }), "event_location: found with method march; use method galerkin");
  options = options_for(Method::galerkin, 20);
  options.event_location = true;
  options.tolerance = 1e-3;
  EXPECT_EQ(refusal([&] { run(scene, options); }), "event_location: found with a tolerance; give steps instead");
}

// Parts of several lengths against the same problem with one part per interval.
TEST(GalerkinLocation, GridsOfSeveralLengths) {
  const Scene scene = make_scene("nash-game", {});
  const std::vector<GridPart> parts{{0.2, 5}, {0.45, 4}, {1, 9}};
  const GalerkinProblem p = galerkin_problem(scene, parts);
  ASSERT_EQ(p.N, 18);
  EXPECT_EQ(p.t[5], 0.2);
  EXPECT_EQ(p.t[9], 0.45);
  std::vector<GridPart> single;
  for (Index k = 1; k <= p.N; ++k) single.push_back({p.t[k], 1});
  const GalerkinProblem q = galerkin_problem(scene, single);
  ASSERT_EQ(q.runs.size(), 18u);
  const RowMatrix z = reference::Random(3).matrix(18, 10);
  EXPECT_LE(distance(apply_galerkin(p, z), apply_galerkin(q, z)), 1e-12 * apply_galerkin(p, z).cwiseAbs().maxCoeff());
  EXPECT_LE(distance(p.q, q.q), 1e-12);
  const std::vector<GridPart> found = grid_parts(p.t);
  ASSERT_EQ(found.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(found[i].intervals, parts[i].intervals);
}

// x' = -x + y + f, y = max(0, -x - g), g jumps at t = 0.3337: by Runge-Kutta on both sides of the jump, 2e5 steps,
// until x(0) = x(1). A kink inside a step costs h^2 = 3e-11. `off`: where y vanishes, by a line through two steps.
struct PeriodicDiode {
  double start = 0, off = 0;
};
PeriodicDiode periodic_diode(const std::function<double(double)>& f, const std::function<double(double)>& g,
                             double jump) {
  PeriodicDiode found;
  const auto rate = [&](double t, double x) { return -x + std::max(0.0, -x - g(t)) + f(t); };
  const auto advance = [&](double x, double from, double to) {
    constexpr int steps = 100000;
    const double h = (to - from) / steps, inside = 1e-14;
    for (int k = 0; k < steps; ++k) {
      const double t = from + k * h, end = std::min(t + h, to - inside);
      const double a = rate(t, x), b = rate(t + h / 2, x + h / 2 * a), c = rate(t + h / 2, x + h / 2 * b),
                   d = rate(end, x + h * c);
      const double before = -x - g(t);
      x += h / 6 * (a + 2 * b + 2 * c + d);
      const double after = -x - g(end);
      if (before > 0 && after <= 0) found.off = t + h * before / (before - after);
    }
    return x;
  };
  double& x = found.start;
  for (int period = 0; period < 30; ++period) x = advance(advance(x, 0, jump), jump, 1);  // e^{-30} = 1e-13
  return found;
}

// Also one that lies on a time point, 134/400.
TEST(GalerkinLocation, KeepsBreakpointsAsNodes) {
  for (const double jump : {0.3337, 0.335}) {
    SCOPED_TRACE(jump);
    const auto f = [](double t) { return 0.2 * std::sin(6 * t); };
    const auto g = [jump](double t) { return t < jump ? 0.5 : -1 + 0.9 * std::sin(9 * t); };
    Scene scene;
    scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
    scene.M = Matrix{{1}};
    scene.f = [&](double t, Eigen::Ref<Vector> v) { v[0] = f(t); };
    scene.g = [&](double t, Eigen::Ref<Vector> v) { v[0] = g(t); };
    scene.breakpoints = {jump};
    scene.boundary = BoundaryCondition{Matrix{{1}}, Matrix{{-1}}, Vector{{0}}};
    Options options = options_for(Method::galerkin, 400);
    options.states = StateSelection::all;
    options.event_location = true;
    const Result r = run(scene, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_TRUE((r.t.array() == jump).any());
    // O(d^2) of nodes that are d = O(h^2) from their kinks, h = 1/400, with derivatives of y up to 9^2: 4e-9.
    const PeriodicDiode known = periodic_diode(f, g, jump);
    EXPECT_NEAR(r.x(0, 0), known.start, 4e-9);
    const auto backend = make_cpu_backend(1);
    for (const Switch& s : switches_with_errors(scene, *backend, options, r))
      if (!s.on) {
        EXPECT_LE(std::abs(s.t - known.off), s.error) << "its error says how far it is off";
      }
  }
}

}  // namespace
}  // namespace bromwich
