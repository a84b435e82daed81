#pragma once
// Structures with contacts of the tests.

#include "mechanics/mechanism.hpp"
#include "tests/support/run.hpp"

#include <cmath>
#include <functional>
#include <vector>

namespace bromwich {

inline SparseMatrix sparse(const Matrix& m) { return m.sparseView(); }

inline TimeFunction of_time(std::function<double(double)> value) {
  return [value](double t, Eigen::Ref<Vector> out) { out.setConstant(value(t)); };
}

inline TimeFunction always(double value) {
  return of_time([value](double) { return value; });
}

inline TimeFunction forces(std::function<Vector(double)> value) {
  return [value](double t, Eigen::Ref<Vector> out) { out = value(t); };
}

/// A unit mass on a spring, pulled by f.
inline Structure oscillator(double damping, double stiffness, std::function<double(double)> f, double T) {
  Structure s;
  s.M = sparse(Matrix{{1}}), s.C = sparse(Matrix{{damping}}), s.K = sparse(Matrix{{stiffness}});
  s.f = of_time(std::move(f));
  s.T = T;
  s.breakpoints_are_all = true;
  return s;
}

/// Two coordinates, along and across a belt, under a load that varies by `load`.
inline Structure block(double load, double T) {
  Structure s;
  const Matrix K{{2, -0.6}, {-0.6, 1.5}};
  s.M = sparse(Matrix::Identity(2, 2)), s.K = sparse(K);
  s.C = sparse(Matrix(0.04 * Matrix::Identity(2, 2) + 0.01 * K));
  s.f = forces([load](double t) { return Vector{{0.3 * std::sin(2.1 * t), -1 + load * std::cos(2.1 * t)}}; });
  s.T = T;
  s.breakpoints_are_all = true;
  return s;
}

inline Contact belt(double restitution = 0) {
  Contact c;
  c.normal = Vector{{0, 1}};
  c.tangent = Matrix{{1, 0}};
  c.velocity = always(0.4);
  c.mu = 0.4;
  c.restitution = restitution;
  return c;
}

/// A body with coupled coordinates that meets the ground aslant, with mu = 0.3.
inline Mechanism oblique_impact() {
  Structure s;
  s.M = sparse(Matrix{{2, -1}, {-1, 2}});
  s.f = forces([](double) { return Vector{{0, -1}}; });
  s.q0 = Vector{{0, 0.1}}, s.v0 = Vector{{-1, -1}};
  s.breakpoints_are_all = true;
  Contact ground = belt();
  ground.velocity = {};
  ground.mu = 0.3;
  return make_mechanism(s, {ground});
}

/// By located events, with all states.
inline Result located(const Scene& scene) {
  Options options = options_for(scene.boundary ? Method::shooting : Method::events);
  options.states = StateSelection::all;
  const Result r = run(scene, options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  return r;
}

inline Vector last_state(const Result& r) { return r.x.row(r.x.rows() - 1).transpose(); }

}  // namespace bromwich
