#pragma once
// An RC filter behind a source of pulses, with a clamp diode, in closed form:
//
//     x' = a (u(t) - x) + a y,    0 <= y ⊥ x + M y - c >= 0,    u = 1 for (t mod 1/P) < D/P, else 0.
//
// With the diode open x decays to u at the rate a. With M > 0 it conducts where x < c, and x decays to (u + c/M) / (1 +
// 1/M) at the rate a (1 + 1/M). With M = 0 it holds x at c. All are exponentials between edges and switches.

#include "core/scene/scene.hpp"

#include <cmath>
#include <vector>

namespace bromwich::oracle {

struct ClampedFilter {
  double a, M, c;
  int periods;    ///< P, in T = 1
  double duty;    ///< D
  double x0 = 0;  ///< with M = 0 at least c

  /// x after `d` from x with this u; no edge is passed.
  double after(double x, double u, double d) const {
    for (int pieces = 0; pieces < 4; ++pieces) {
      const bool conducts = x < c || (x == c && u < c);
      if (conducts && M == 0) return c;
      const double limit = conducts ? (u + c / M) / (1 + 1 / M) : u, rate = conducts ? a * (1 + 1 / M) : a;
      const double end = limit + (x - limit) * std::exp(-rate * d);
      const bool crosses = conducts ? end > c : end < c;
      if (!crosses) return end;
      const double time = std::log((x - limit) / (c - limit)) / rate;
      if (time >= d) return end;
      d -= time;
      x = std::nextafter(c, conducts ? INFINITY : -INFINITY);
      if (M == 0) x = c;
    }
    return x;
  }

  /// x at increasing times of [0, 1].
  std::vector<double> states(const std::vector<double>& times) const {
    std::vector<double> found;
    double x = x0, t = 0;
    std::size_t next = 0;
    for (int k = 0; k < periods; ++k)
      for (const double u : {1.0, 0.0}) {
        const double edge = u > 0 ? (k + duty) / periods : double(k + 1) / periods;
        while (next < times.size() && times[next] < edge) found.push_back(after(x, u, times[next++] - t));
        x = after(x, u, edge - t);
        t = edge;
      }
    while (next++ < times.size()) found.push_back(x);
    return found;
  }

  std::vector<double> edges() const {
    std::vector<double> all;
    for (int k = 0; k < periods; ++k) {
      if (k > 0) all.push_back(double(k) / periods);
      all.push_back((k + duty) / periods);
    }
    return all;
  }

  /// With its edges stated.
  Scene scene() const {
    Scene s;
    s.dynamics = DenseDynamics{Matrix{{-a}}, Matrix{{a}}, Matrix{{1}}};
    s.M = Matrix{{M}};
    s.f = [f = *this](double t, Eigen::Ref<Vector> v) {
      const double phase = t * f.periods - std::floor(t * f.periods);
      v[0] = phase < f.duty ? f.a : 0;
    };
    s.g = [c = c](double, Eigen::Ref<Vector> v) { v[0] = -c; };
    s.breakpoints = edges();
    s.breakpoints_are_all = true;
    s.x0 = Vector::Constant(1, x0);
    s.T = 1;
    return s;
  }

  /// Among other states that decay, so many that the scene stays sparse.
  Scene sparse_scene() const {
    constexpr Index m = 600;
    SparseDynamics d;
    d.A.resize(m, m), d.B.resize(m, 1), d.N.resize(1, m);
    for (Index i = 0; i < m; ++i) d.A.insert(i, i) = i == 0 ? -a : -1 - double(i) / m;
    d.B.insert(0, 0) = a;
    d.N.insert(0, 0) = 1;
    Scene s = scene();
    s.dynamics = d;
    s.f_entry = SourceEntry::through_B;
    s.f = [f = *this](double t, Eigen::Ref<Vector> v) {
      const double phase = t * f.periods - std::floor(t * f.periods);
      v[0] = phase < f.duty ? 1 : 0;
    };
    s.x0 = x0 * Vector::Unit(m, 0);
    return s;
  }
};

}  // namespace bromwich::oracle
