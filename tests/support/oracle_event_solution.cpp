// Values of an event-driven solution at any time, and distances of two of them.

#include "tests/support/oracle_collocation.hpp"
#include "tests/support/oracle_events.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

namespace bromwich::oracle {

const EventPiece& EventSolution::piece(double t, bool left) const {
  const auto after = [left](double at, const EventPiece& p) { return left ? at <= p.begin : at < p.begin; };
  auto it = std::upper_bound(pieces.begin(), pieces.end(), t, after);
  if (it != pieces.begin()) --it;
  return *it;
}

Vector EventSolution::at(double t, bool left, Matrix EventPiece::*values) const {
  const EventPiece& p = piece(t, left);
  const double s = std::clamp((t - p.begin) / p.length, 0.0, (p.end - p.begin) / p.length);
  return (p.*values).transpose() * legendre(s);
}

Vector EventSolution::integral(double t, bool left) const {
  const EventPiece& p = piece(t, left);
  const double s = std::clamp((t - p.begin) / p.length, 0.0, (p.end - p.begin) / p.length);
  return p.integral + p.length * (p.y.transpose() * legendre_integrals(s));
}

Vector EventSolution::largest(Matrix EventPiece::*values) const {
  Vector most = Vector::Zero((pieces.front().*values).cols());
  for (const EventPiece& p : pieces)
    for (const double part : {0.0, 0.25, 0.5, 0.75, 1.0}) {
      const double s = part * std::min(1.0, (p.end - p.begin) / p.length);
      most = most.cwiseMax(((p.*values).transpose() * legendre(s)).cwiseAbs());
    }
  return most;
}

Vector EventSolution::largest_integral() const {
  Vector most = Vector::Zero(pieces.front().integral.size());
  for (const EventPiece& p : pieces) most = most.cwiseMax(p.integral.cwiseAbs());
  return most.cwiseMax(integral(until).cwiseAbs());
}

Vector measure(const Vector& largest) {
  if (largest.size() == 0) return largest;
  return largest.cwiseMax(1e-3 * largest.maxCoeff()).cwiseMax(1e-290);
}

Apart apart(const EventSolution& a, const EventSolution& b, double T, Index count) {
  if (!a.decided || !b.decided) return {INFINITY, INFINITY, INFINITY};
  const Vector x = measure(a.largest_x()), y = measure(a.largest_y()), mean = measure(a.largest_integral());
  Apart d;
  const auto worst = [](const Vector& u, const Vector& v, const Vector& size) {
    return u.size() == 0 ? 0.0 : (u - v).cwiseAbs().cwiseQuotient(size).maxCoeff();
  };
  for (Index j = 1; j <= count; ++j) {
    // An irrational fraction of the interval, where events are unlikely.
    const double t = T * (j == count ? 1.0 : (double(j) - 0.381966011250105) / double(count));
    d.x = std::max(d.x, worst(a.x(t), b.x(t), x));
    d.y = std::max(d.y, worst(a.y(t), b.y(t), y));
    d.mean = std::max(d.mean, worst(a.integral(t), b.integral(t), mean));
  }
  return d;
}

EventScene perturbed(const EventScene& e, double size, std::uint32_t seed) {
  std::mt19937 engine(seed);
  const auto factor = [&] { return 1 + size * (2 * double(engine()) / 4294967296.0 - 1); };
  EventScene p = e;
  DenseScene& s = p.scene;
  const Index n = s.M.rows(), m = s.A.rows();
  for (Index i = 0; i < m; ++i)
    for (Index j = 0; j < m; ++j) s.A(i, j) *= factor();
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < m; ++j) {
      const double both = factor();
      s.N(i, j) *= both;
      s.B(j, i) *= both;
    }
  Vector scale(n), of_f(m), of_g(n);
  for (double& v : scale) v = factor();
  for (double& v : of_f) v = factor();
  for (double& v : of_g) v = factor();
  s.M = (scale.asDiagonal() * s.M * scale.asDiagonal()).eval();
  for (double& v : s.x0) v *= factor();
  const auto times = [](TimeFunction function, Vector by) {
    return [function = std::move(function), by = std::move(by)](double t, Eigen::Ref<Vector> v) {
      function(t, v);
      v.array() *= by.array();
    };
  };
  s.f = times(s.f, of_f);
  s.g = times(s.g, of_g);
  return p;
}

}  // namespace bromwich::oracle
