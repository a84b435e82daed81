// Sources that are faster than the grid, on fixed grids: what enters the solution, against integrals by hand.

#include "core/scene/source_steps.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/clamped_filter.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

namespace bromwich {
namespace {

/// A square wave of `turns` periods in [0, 1]: 1 during a share `duty` of each period, then -0.3.
struct FastSquare {
  double turns, duty, phase;

  double operator()(double t) const {
    const double at = turns * t + phase;
    return at - std::floor(at) < duty ? 1 : -0.3;
  }
  double integral(double t) const { return (sum(turns * t + phase) - sum(phase)) / turns; }

 private:
  double sum(double at) const {
    const double whole = std::floor(at), rest = at - whole;
    return whole * (duty - 0.3 * (1 - duty)) + std::min(rest, duty) - 0.3 * std::max(0.0, rest - duty);
  }
};

Scene integrator() {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix::Zero(1, 1), Matrix::Ones(1, 1), Matrix::Zero(1, 1)};
  scene.M = Matrix(Matrix::Ones(1, 1));
  scene.x0 = Vector::Zero(1);
  return scene;
}

Result on_grid(const Scene& scene, Method method, Index J) {
  Options options;
  options.method = method;
  options.steps = J;
  options.states = StateSelection::all;
  return solve(scene, *make_cpu_backend(1), options);
}

// As grids that are compared have them.
SourceSteps steps_of(const Scene& scene, Index J) {
  const Vector t = Vector::LinSpaced(J + 1, 0, scene.T);
  return find_source_steps(scene, t, sample(scene.f, t, scene.sources()), sample(scene.g, t, scene.constraints()),
                           true);
}

double error_of_x(const Result& r, const std::function<double(double)>& exact) {
  double most = 0;
  for (Index j = 0; j < r.t.size(); ++j) most = std::max(most, std::abs(r.x(j, 0) - exact(r.t[j])));
  return most;
}

// The places of 900 jumps are known to 256 roundings of T each, and a jump moves x by 1.3 times that.
constexpr double rounding_of_jumps = 900 * 1.3 * 256 * 2.2e-16;

TEST(FastSources, SquareWavesInFEnterByTheirIntegral) {
  for (const FastSquare& wave :
       {FastSquare{431.37, 0.33, 0.2}, FastSquare{233.1, 0.12, 0.7}, FastSquare{397, 0.9, 0}}) {
    Scene scene = integrator();
    scene.f = [wave](double t, Eigen::Ref<Vector> f) { f[0] = wave(t); };
    scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = 1; };
    for (const Method method : {Method::march, Method::contour, Method::euler}) {
      const Result r = on_grid(scene, method, 400);
      ASSERT_EQ(r.status, Status::solved) << r.reason;
      EXPECT_LE(error_of_x(r, [&](double t) { return wave.integral(t); }), rounding_of_jumps)
          << wave.turns << " " << to_string(method);
    }
  }
}

// y = 2 + the wave, and x' = y.
TEST(FastSources, SquareWavesInGAreTakenInPartsByMarch) {
  for (const FastSquare& wave :
       {FastSquare{431.37, 0.33, 0.2}, FastSquare{233.1, 0.12, 0.7}, FastSquare{397, 0.9, 0}}) {
    Scene scene = integrator();
    scene.g = [wave](double t, Eigen::Ref<Vector> g) { g[0] = -2 - wave(t); };
    const Result r = on_grid(scene, Method::march, 400);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_LE(error_of_x(r, [&](double t) { return 2 * t + wave.integral(t); }), rounding_of_jumps) << wave.turns;
  }
}

TEST(FastSources, OthersWarnOfFastG) {
  Scene scene = integrator();
  scene.g = [wave = FastSquare{431.37, 0.33, 0.2}](double t, Eigen::Ref<Vector> g) { g[0] = -2 - wave(t); };
  for (const Method method : {Method::contour, Method::multigrid, Method::euler})
    EXPECT_NE(on_grid(scene, method, 400).warning, "") << to_string(method);
}

// Looks into a step are at most 0.035 steps apart.
TEST(FastSources, ShortPulsesBesideFastOnesAreSeen) {
  constexpr Index J = 400;
  const double width = 0.04 / J, height = 2;
  const FastSquare wave{200, 0.5, 0.1};  // makes every step be looked into
  for (double begin = 0.3; begin < 0.32; begin += 0.37 / J) {
    Scene scene = integrator();
    scene.f = [=](double t, Eigen::Ref<Vector> f) { f[0] = wave(t) + (t >= begin && t < begin + width ? height : 0); };
    scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = 1; };
    const auto exact = [&](double t) { return wave.integral(t) + height * std::clamp(t - begin, 0.0, width); };
    EXPECT_LE(error_of_x(on_grid(scene, Method::march, J), exact), rounding_of_jumps) << begin;
  }
}

// 1600 periods a step, which no division resolves: that is said, after a few steps were tried to the end.
TEST(FastSources, WhatCannotBeResolvedIsGivenUpEarly) {
  constexpr Index J = 400;
  long calls = 0;
  Scene scene = integrator();
  scene.f = [&calls](double t, Eigen::Ref<Vector> value) {
    ++calls;
    value.setConstant(std::sin(4e6 * t));
  };
  const Result r = on_grid(scene, Method::march, J);
  EXPECT_GT(r.unresolved_sources, 0.1);
  EXPECT_NE(r.warning, "");
  // At most 8 values for each leaf, 2048 leaves in 16 steps and 128 in the others; 60 looks into each step before.
  EXPECT_LE(calls, 8 * (16 * 2048 + J * 128) + 60 * J);
}

// 250 edges in each of four steps: all of them are ends of parts, and the pieces of f have its integral.
TEST(SourceSteps, KeepAllEdgesOfAStep) {
  const oracle::ClampedFilter filter{1, 1, 0, 500, 0.3};
  const Scene scene = filter.scene();
  const SourceSteps steps = steps_of(scene, 4);
  ASSERT_EQ(steps.rough.size(), 4u);
  double integral = 0;
  std::vector<double> ends;
  for (const RoughStep& rough : steps.rough) {
    ends.insert(ends.end(), rough.ends.begin(), rough.ends.end());
    for (const SourcePiece& piece : rough.pieces)
      integral += piece.length * (piece.phi * Eigen::Vector3d(1, 1.0 / 2, 1.0 / 3))[0];
  }
  for (const double edge : scene.breakpoints)
    EXPECT_TRUE(std::binary_search(ends.begin(), ends.end(), edge) || std::abs(4 * edge - std::round(4 * edge)) < 1e-12)
        << edge;
  EXPECT_NEAR(integral, 0.3, 1000 * 256 * 2.2e-16);  // every edge to 256 roundings of T
}

// Pulses of a thousandth of the step: no point of any of these grids falls into one, and twice the steps have twice the
// parts there.
TEST(SourceSteps, DividePulsesInsideStepsFurtherOnFinerGrids) {
  const oracle::ClampedFilter filter{1, 1, 0, 3, 1e-5};
  const Scene scene = filter.scene();
  const auto parts = [&](Index J) {
    Index count = 0;
    for (const RoughStep& rough : steps_of(scene, J).rough)
      count += std::count_if(rough.ends.begin(), rough.ends.end(),
                             [&](double t) { return t > 1.0 / 3 * (1 + 1e-12) && t < (1 + 1e-5) / 3 * (1 + 1e-12); });
    return count;
  };
  const Index first = parts(80);
  EXPECT_GE(first, 8);
  for (const Index factor : {2, 4, 8}) EXPECT_NEAR(double(parts(80 * factor)), double(factor * first), factor);
}

}  // namespace
}  // namespace bromwich
