// A mass between a spring and a rigid stop, with damping and a periodic force:
//
//     x'' = -k x - c x' + F cos(omega t + p) + G + y,   0 <= y ⊥ x >= 0,   impacts inelastic,
//
// against a solution of its own: Runge-Kutta steps of 1e-4 in flight, impacts located by bisection, rest until the
// force on the mass at the stop turns positive. Its errors are below 1e-7.

#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace bromwich {
namespace {

struct Oscillator {
  double k, c, F, omega, p, G, x0, v0;

  double force(double t) const { return F * std::cos(omega * t + p) + G; }
  double acceleration(double t, double x, double v) const { return -k * x - c * v + force(t); }
};

struct Motion {
  std::vector<double> x, v, impacts;  ///< at multiples of the sampling step; times of impacts
};

constexpr double T = 6, dt = 1e-4;
constexpr int sampled_every = 100;

void fly(const Oscillator& o, double t, double h, double& x, double& v) {
  const double a1 = o.acceleration(t, x, v), x2 = x + h / 2 * v, v2 = v + h / 2 * a1;
  const double a2 = o.acceleration(t + h / 2, x2, v2), x3 = x + h / 2 * v2, v3 = v + h / 2 * a2;
  const double a3 = o.acceleration(t + h / 2, x3, v3), x4 = x + h * v3, v4 = v + h * a3;
  const double a4 = o.acceleration(t + h, x4, v4);
  x += h / 6 * (v + 2 * v2 + 2 * v3 + v4);
  v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
}

// The part of a step of length h until x = 0 is crossed, or force on the resting mass is positive.
template <class Before>
double located(double h, const Before& before) {
  double low = 0, high = h;
  for (int i = 0; i < 50; ++i) (before((low + high) / 2) ? low : high) = (low + high) / 2;
  return high;
}

Motion move(const Oscillator& o) {
  Motion motion;
  double x = o.x0, v = o.v0;
  bool rests = false;
  const int steps = int(std::lround(T / dt));
  for (int i = 0; i <= steps; ++i) {
    if (i % sampled_every == 0) motion.x.push_back(x), motion.v.push_back(v);
    double t = i * dt;
    for (double left = dt; left > 0;) {
      if (rests) {
        if (o.force(t + left) <= 0) break;
        const double s = located(left, [&](double at) { return o.force(t + at) <= 0; });
        rests = false;
        t += s, left -= s;
        continue;
      }
      double x1 = x, v1 = v;
      fly(o, t, left, x1, v1);
      if (x1 >= 0) {
        x = x1, v = v1;
        break;
      }
      const double s = located(left, [&](double at) {
        double xs = x, vs = v;
        fly(o, t, at, xs, vs);
        return xs >= 0;
      });
      motion.impacts.push_back(t + s);
      x = v = 0;
      t += s, left -= s;
      rests = o.force(t) <= 0;
    }
  }
  return motion;
}

Scene scene_of(const Oscillator& o) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {-o.k, -o.c}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.M = Matrix{{0}};
  scene.f = [o](double t, Eigen::Ref<Vector> f) { f << 0, o.force(t); };
  scene.x0 = Vector{{o.x0, o.v0}};
  scene.T = T;
  scene.default_steps = 300;
  return scene;
}

TEST(Impacts, OfForcedOscillatorsAreThoseOfTheOracle) {
  constexpr int count = 24;
  constexpr double tolerance = 1e-3;
  reference::Random random(7);
  const auto draw = [&](double low, double high) { return random.uniform(low, high); };
  const auto backend = make_cpu_backend(1);
  int solved = 0;
  std::size_t impacts = 0;
  for (int n = 0; n < count; ++n) {
    const Oscillator o{
        draw(0, 30), draw(-1, 2) > 0 ? draw(0, 2) : 0, draw(0, 20), draw(1, 8), draw(0, 6), draw(-10, 2), draw(0.05, 1),
        draw(-2, 2)};
    const Motion exact = move(o);
    impacts += exact.impacts.size();
    Options options;
    options.tolerance = tolerance;
    options.states = StateSelection::all;
    options.max_steps = 1 << 16;
    const Result r = solve(scene_of(o), *backend, options);
    if (r.status != Status::solved) continue;
    ++solved;
    const Index samples = Index(exact.x.size());
    const Eigen::Map<const Vector> x(exact.x.data(), samples), v(exact.v.data(), samples);
    const double size_x = x.cwiseAbs().maxCoeff(), size_v = v.cwiseAbs().maxCoeff(),
                 size = std::max(size_x, 1e-3 * size_v);
    for (Index j = 0; j <= r.steps; ++j) {
      const double at = r.t[j] / (dt * sampled_every);
      const Index i = Index(std::lround(at));
      if (i >= samples || std::abs(at - double(i)) > 1e-9) continue;
      EXPECT_LE(std::abs(r.x(j, 0) - x[i]), 3 * tolerance * size) << n << " at " << r.t[j];
      bool near = false;
      for (const double t : exact.impacts) near = near || std::abs(t - r.t[j]) < 2 * T / double(r.steps);
      if (!near) {
        EXPECT_LE(std::abs(r.x(j, 1) - v[i]), 3 * tolerance * size_v) << n << " at " << r.t[j];
      }
    }
  }
  EXPECT_GT(impacts, std::size_t(count)) << "some of them touch the stop";
  EXPECT_GE(solved, count - 3);
}

}  // namespace
}  // namespace bromwich
