#pragma once
// Masses that bounce, with an oracle: the exact flow between impacts that bisection locates. It shares no code with the
// solver.

#include "core/scene/scene.hpp"

#include <unsupported/Eigen/MatrixFunctions>

#include <cstdint>
#include <optional>
#include <random>
#include <vector>

namespace bromwich {

inline TimeFunction constant(const Vector& value) {
  return [value](double, Eigen::Ref<Vector> v) { v = value; };
}

/// Masses on springs with dampers above floors, driven by cos(2 t): states (q, v, cos, sin), one floor for each mass.
struct Bouncing {
  Matrix A;      ///< of all states
  Vector floor;  ///< q_i >= floor_i
  Vector e, mass, x0;
  Index k() const { return floor.size(); }

  explicit Bouncing(std::uint32_t seed) {
    std::mt19937 random(seed);
    const auto draw = [&](double from, double to) { return std::uniform_real_distribution<double>(from, to)(random); };
    const Index k = 1 + Index(seed % 3), m = 2 * k + 2;
    A = Matrix::Zero(m, m);
    floor.resize(k), e.resize(k), mass.resize(k), x0 = Vector::Zero(m);
    A.block(0, k, k, k).setIdentity();
    for (Index i = 0; i < k; ++i) {
      mass[i] = draw(0.5, 2);
      floor[i] = draw(-0.6, -0.1);
      e[i] = draw(0.3, 1);
      x0[i] = draw(0, 0.5);
      x0[k + i] = draw(-1, 1);
      A(k + i, i) -= draw(1, 20) / mass[i];
      A(k + i, k + i) -= draw(0, 0.3) / mass[i];
      A(k + i, m - 2) = draw(-4, 4) / mass[i];
      if (i > 0) {
        const double spring = draw(1, 10);
        A(k + i, i) -= spring / mass[i], A(k + i, i - 1) += spring / mass[i];
        A(k + i - 1, i - 1) -= spring / mass[i - 1], A(k + i - 1, i) += spring / mass[i - 1];
      }
    }
    A(m - 2, m - 1) = -2, A(m - 1, m - 2) = 2;
    x0[m - 2] = 1;
  }

  Scene scene(double T) const {
    const Index k = this->k(), m = A.rows();
    Matrix B = Matrix::Zero(m, k), N = Matrix::Zero(k, m);
    for (Index i = 0; i < k; ++i) B(k + i, i) = 1 / mass[i], N(i, i) = 1;
    Scene s;
    s.dynamics = DenseDynamics{A, B, N};
    s.M = Matrix::Zero(k, k);
    s.g = constant(-floor);
    s.breakpoints_are_all = true;
    s.x0 = x0;
    s.restitution = e;
    s.T = T;
    return s;
  }

  /// The state at T by the exact flow between impacts, which bisection locates; nothing where a flight is so short that
  /// a contact may come to rest.
  std::optional<Vector> flown(double T) const { return flown_from(x0, T); }
  std::optional<Vector> flown_from(Vector x, double T) const {
    constexpr double look = 1e-3, shortest = 1e-2;
    const Matrix step = (look * A).exp();
    std::vector<double> last(std::size_t(k()), -1.0);
    for (double t = 0; t < T - 1e-12;) {
      const bool whole = T - t >= look;
      const double h = whole ? look : T - t;
      const Vector next = whole ? Vector(step * x) : Vector((h * A).exp() * x);
      Index hit = -1;
      for (Index i = 0; i < k(); ++i)
        if (next[i] < floor[i]) {
          if (hit >= 0) return std::nullopt;  // two in one look: they are not told apart
          hit = i;
        }
      if (hit < 0) {
        x = next;
        t += h;
        continue;
      }
      double before = 0, after = h;
      for (int n = 0; n < 60; ++n) {
        const double middle = (before + after) / 2;
        (Vector((middle * A).exp() * x)[hit] < floor[hit] ? after : before) = middle;
      }
      x = (before * A).exp() * x;
      t += before;
      if (t - last[std::size_t(hit)] < shortest) return std::nullopt;
      last[std::size_t(hit)] = t;
      x[hit] = floor[hit];
      x[k() + hit] *= -e[hit];
    }
    return x;
  }
};

}  // namespace bromwich
