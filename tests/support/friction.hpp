#pragma once
// Planar contacts with friction as linear complementarity systems.
//
// symbol  shape  meaning
// q, v    k      positions and velocities, x = (q, v): mass q'' + damping q' + stiffness q = f + Hn^T l + Ht^T s
// l       p      normal forces, 0 <= l ⊥ Hn q >= 0
// b, c    p      s = b - mu l, |s| <= mu l:  0 <= b ⊥ Ht v - V + c >= 0,  0 <= c ⊥ 2 mu l - b >= 0
// y       3p     (l, b, c) of one contact after the other

#include "core/scene/scene.hpp"

#include <Eigen/LU>

namespace bromwich::oracle {

struct Contacts {
  Matrix mass, damping, stiffness, Hn, Ht;
  Vector V, mu, x0;
  std::function<Vector(double t)> f;
  double T = 1;
};

inline Scene friction_scene(const Contacts& c) {
  const Index k = c.mass.rows(), p = c.Hn.rows();
  const Matrix inverse = c.mass.inverse();
  DenseDynamics d;
  d.A = Matrix::Zero(2 * k, 2 * k);
  d.A.topRightCorner(k, k).setIdentity();
  d.A.bottomLeftCorner(k, k) = -inverse * c.stiffness;
  d.A.bottomRightCorner(k, k) = -inverse * c.damping;
  d.B = Matrix::Zero(2 * k, 3 * p);
  d.N = Matrix::Zero(3 * p, 2 * k);
  Matrix M = Matrix::Zero(3 * p, 3 * p);
  Vector g = Vector::Zero(3 * p);
  for (Index i = 0; i < p; ++i) {
    const Index l = 3 * i, b = l + 1, slip = l + 2;
    d.B.col(l).tail(k) = inverse * (c.Hn.row(i) - c.mu[i] * c.Ht.row(i)).transpose();
    d.B.col(b).tail(k) = inverse * c.Ht.row(i).transpose();
    d.N.row(l).head(k) = c.Hn.row(i);
    d.N.row(b).tail(k) = c.Ht.row(i);
    M(b, slip) = 1;
    M(slip, l) = 2 * c.mu[i];
    M(slip, b) = -1;
    g[b] = -c.V[i];
  }
  Scene scene;
  scene.name = "friction";
  scene.dynamics = d;
  scene.M = M;
  scene.x0 = c.x0;
  scene.T = c.T;
  scene.f = [f = c.f, inverse, k](double t, Eigen::Ref<Vector> v) {
    v.setZero();
    v.tail(k) = inverse * f(t);
  };
  scene.g = [g](double, Eigen::Ref<Vector> v) { v = g; };
  return scene;
}

/// The same seen in a mirror: q_0 and the tangents have other signs.
inline Contacts mirrored(Contacts c) {
  const Index k = c.mass.rows();
  Vector sign = Vector::Ones(k);
  sign[0] = -1;
  const auto D = sign.asDiagonal();
  for (Matrix* m : {&c.mass, &c.damping, &c.stiffness}) *m = (D * *m * D).eval();
  c.Hn = (c.Hn * D).eval();
  c.Ht = (-c.Ht * D).eval();
  c.V = -c.V;
  c.x0.head(k) = (D * c.x0.head(k)).eval();
  c.x0.tail(k) = (D * c.x0.tail(k)).eval();
  c.f = [f = c.f, sign](double t) { return Vector(sign.cwiseProduct(f(t))); };
  return c;
}

}  // namespace bromwich::oracle
