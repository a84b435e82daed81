#pragma once
// What tests of nonlinear scenes share: a reference by Runge-Kutta, and a scene with an exact solution.

#include "cpu/cpu_backend.hpp"
#include "nonlinear/solve_nonlinear.hpp"

#include <gtest/gtest.h>

#include <functional>

namespace bromwich {

// x at T by Runge-Kutta of order 4, y = y(t, x) given.
inline Vector by_runge_kutta(const NonlinearScene& s, const std::function<Vector(double, const Vector&)>& y_of,
                             Index steps) {
  const DenseDynamics& d = *s.linear.dynamics->small_state();
  const auto rate = [&](double t, const Vector& x) {
    const Vector y = y_of(t, x);
    Vector v = d.A * x + d.B * y, more = Vector::Zero(x.size());
    if (s.linear.f) s.linear.f(t, more), v += more;
    if (s.phi) s.phi(t, x, y, more), v += more;
    return v;
  };
  const double h = s.linear.T / double(steps);
  Vector x = s.linear.x0;
  for (Index j = 0; j < steps; ++j) {
    const double t = double(j) * h;
    const Vector a = rate(t, x), b = rate(t + h / 2, x + h / 2 * a), c = rate(t + h / 2, x + h / 2 * b);
    const Vector e = rate(t + h, x + h * c);
    x += h / 6 * (a + 2 * b + 2 * c + e);
  }
  return x;
}

inline NonlinearResult solved_by(const NonlinearScene& s, NonlinearMethod method, Index steps) {
  const auto backend = make_cpu_backend();
  NonlinearOptions options;
  options.method = method;
  options.steps = steps;
  const NonlinearResult r = solve_nonlinear(s, *backend, options);
  EXPECT_EQ(r.status, Status::solved) << to_string(method) << ": " << r.reason;
  return r;
}

/// x' = -1 - x^2 + y, x >= 0 from 1: x = tan(pi/4 - t) until pi/4, and then x = 0, y = 1.
inline NonlinearScene stopped() {
  NonlinearScene s;
  s.linear.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1}}, Matrix{{1}}};
  s.linear.M = Matrix{{0}};
  s.linear.f = [](double, Eigen::Ref<Vector> v) { v[0] = -1; };
  s.linear.x0 = Vector{{1}};
  s.linear.T = 2;
  s.phi = [](double, const Eigen::Ref<const Vector>& x, const Eigen::Ref<const Vector>&, Eigen::Ref<Vector> v) {
    v[0] = -x[0] * x[0];
  };
  return s;
}

}  // namespace bromwich
