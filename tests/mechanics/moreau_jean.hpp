#pragma once
// Time stepping by Moreau and Jean with theta = 1/2: the second opinion on structures with contacts. It shares no code
// with the solver: velocities and impulses of steps, contacts one after the other until nothing changes (projected
// Gauss-Seidel), no located impacts. The error is of the order of the step.

#include "mechanics/mechanism.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich::oracle {

struct Motion {
  Vector q, v;
};

/// Planar contacts with constant gaps and velocities, rigid or compliant; from q = v = 0.
inline Motion moreau_jean(const Mechanism& m, double T, double step) {
  const Structure& s = m.structure;
  const Index d = m.coordinates(), n = Index(m.contacts.size()), steps = Index(std::llround(T / step));
  const double h = T / double(steps);
  const auto at = [](const TimeFunction& function, double t, Index size) {
    Vector value = Vector::Zero(size);
    if (function) function(t, value);
    return value;
  };
  const Matrix C = s.C.size() > 0 ? Matrix(s.C) : Matrix(Matrix::Zero(d, d));
  const Matrix K = s.K.size() > 0 ? Matrix(s.K) : Matrix(Matrix::Zero(d, d));
  const Eigen::PartialPivLU<Matrix> lu(Matrix(Matrix(s.M) + h / 2 * C + h * h / 4 * K));
  Matrix H = Matrix::Zero(2 * n, d);
  Vector gap(n), belt(n);
  for (Index i = 0; i < n; ++i) {
    const Contact& c = m.contacts[std::size_t(i)];
    H.row(2 * i) = c.normal.transpose();
    if (c.mu > 0) H.row(2 * i + 1) = c.tangent.row(0);
    gap[i] = at(c.gap, 0, 1)[0];
    belt[i] = at(c.velocity, 0, 1)[0];
  }
  const Matrix moved = lu.solve(Matrix(H.transpose())), W = H * moved;
  Motion now{Vector::Zero(d), Vector::Zero(d)};
  Vector p = Vector::Zero(2 * n);
  for (Index k = 0; k < steps; ++k) {
    const double t = double(k) * h;
    const Vector f = (at(s.f, t, d) + at(s.f, t + h, d)) / 2;
    const Vector free = now.v + lu.solve(Vector(h * (f - C * now.v - K * now.q - h / 2 * (K * now.v))));
    const Vector before = H * now.v, u = H * free;
    for (int sweep = 0; sweep < 2000; ++sweep) {
      const Vector last = p;
      for (Index i = 0; i < n; ++i) {
        const Contact& c = m.contacts[std::size_t(i)];
        const Index a = 2 * i, b = a + 1;
        const double g = gap[i] + c.normal.dot(now.q), rest = u[a] + W.row(a).dot(p) - W(a, a) * p[a];
        const bool closed = g + h / 2 * before[a] <= 0;
        if (c.kn > 0)
          p[a] = std::max(0.0, -(g + h / 4 * (rest + before[a])) / (1 / (h * c.kn) + h / 4 * W(a, a)));
        else
          p[a] = closed ? std::max(0.0, -(rest + c.restitution * before[a]) / W(a, a)) : 0;
        if (c.mu > 0) {
          const double slides = u[b] + W.row(b).dot(p) - W(b, b) * p[b] - belt[i];
          p[b] = std::clamp(-slides / W(b, b), -c.mu * p[a], c.mu * p[a]);
        }
      }
      if ((p - last).cwiseAbs().maxCoeff() <= 1e-13 * (1 + p.cwiseAbs().maxCoeff())) break;
    }
    const Vector v = free + moved * p;
    now.q += h / 2 * (now.v + v);
    now.v = v;
  }
  return now;
}

}  // namespace bromwich::oracle
