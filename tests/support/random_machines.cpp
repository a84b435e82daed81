// Random chains of masses and systems of tanks.

#include "tests/support/engineering_scene.hpp"
#include "tests/support/random_draws.hpp"

#include <Eigen/Dense>

#include <cmath>
#include <numbers>

namespace bromwich::oracle {
namespace {

/// Adds columns of B, rows of N and entries of M.
class Constraints {
 public:
  explicit Constraints(EngineeringScene& s) : s_(s) {
    s.B.resize(s.states(), 0), s.N.resize(0, s.states()), s.M.resize(0, 0);
    s.G.resize(0, Index(s.signals.size()));
  }
  /// y drives the states by `drives` and sees them as `sees`, with g = constant; its index.
  Index add(const Vector& drives, const Vector& sees, double constant, double M = 0) {
    const Index n = s_.constraints();
    s_.B.conservativeResize(Eigen::NoChange, n + 1), s_.N.conservativeResize(n + 1, Eigen::NoChange);
    s_.G.conservativeResize(n + 1, Eigen::NoChange), s_.M.conservativeResize(n + 1, n + 1);
    s_.M.row(n).setZero(), s_.M.col(n).setZero(), s_.G.row(n).setZero();
    s_.B.col(n) = drives, s_.N.row(n) = sees.transpose(), s_.G(n, 0) = constant, s_.M(n, n) = M;
    return n;
  }

 private:
  EngineeringScene& s_;
};

class Chain {
 public:
  Chain(Draw& d, EngineeringScene& s) : d_(d), s_(s) {}

  void make() {
    const Index masses = d_.index(1, 4);
    planar_ = d_.chance(0.5);
    dofs_ = masses + (planar_ ? 1 : 0);  // the last one is the normal direction of the last mass
    const double mass = std::pow(10, d_.uniform(-1, 1)), rate = std::pow(10, d_.uniform(-1, 1.5));
    force_ = mass * rate * rate;  // displacements are of size 1
    s_.period = 2 * std::numbers::pi / (rate * d_.uniform(0.6, 2));
    inverse_ = Matrix(Vector::NullaryExpr(dofs_, [&] { return 1 / (mass * d_.uniform(0.5, 2)); }).asDiagonal());
    if (planar_ && d_.chance(0.4)) {  // the two directions of the last mass are coupled, as by a lever
      const double a = inverse_(dofs_ - 2, dofs_ - 2), b = inverse_(dofs_ - 1, dofs_ - 1);
      inverse_(dofs_ - 2, dofs_ - 1) = inverse_(dofs_ - 1, dofs_ - 2) = d_.uniform(-0.5, 0.5) * std::min(a, b);
    }
    structure(masses, mass * rate * rate);
    loads(rate);
    contacts_and_friction(masses, rate);
    s_.x0 = Vector::Zero(2 * dofs_);
    if (planar_ && d_.chance(0.7)) s_.x0[dofs_ - 1] = d_.uniform(0, 0.5);
    if (d_.chance(0.4))
      for (Index i = 0; i < masses; ++i) s_.x0[dofs_ + i] = rate * d_.uniform(-0.5, 0.5);
    s_.T = s_.period * d_.uniform(2, 5);
  }

 private:
  Vector position(Index i, double factor = 1) const { return factor * Vector::Unit(2 * dofs_, i); }
  Vector speed(Index i) const { return Vector::Unit(2 * dofs_, dofs_ + i); }
  Vector push(Index i, double factor = 1) const {
    Vector v = Vector::Zero(2 * dofs_);
    v.tail(dofs_) = factor * inverse_.col(i);
    return v;
  }

  void structure(Index masses, double stiffness) {
    Matrix K = Matrix::Zero(dofs_, dofs_);
    const auto spring = [&](Index i, Index j, double k) {
      K(i, i) += k;
      if (j >= 0) K(j, j) += k, K(i, j) -= k, K(j, i) -= k;
    };
    for (Index i = 0; i < masses; ++i) {
      if (i + 1 < masses) spring(i, i + 1, stiffness * d_.uniform(0.5, 4));
      if (i == 0 || d_.chance(0.3)) spring(i, -1, stiffness * d_.uniform(0.3, 2));
    }
    if (planar_) spring(dofs_ - 1, -1, stiffness * d_.uniform(0.5, 2));
    if (planar_ && d_.chance(0.5)) spring(dofs_ - 1, dofs_ - 2, stiffness * d_.uniform(0.1, 0.5));
    const double damping = std::pow(10, d_.uniform(-2, -0.3)) * std::sqrt(K.maxCoeff() / inverse_.maxCoeff());
    const Matrix C = damping / K.maxCoeff() * K;
    s_.A = Matrix::Zero(2 * dofs_, 2 * dofs_);
    s_.A.topRightCorner(dofs_, dofs_).setIdentity();
    s_.A.bottomLeftCorner(dofs_, dofs_) = -inverse_ * K;
    s_.A.bottomRightCorner(dofs_, dofs_) = -inverse_ * C;
    s_.weight = Vector(2 * dofs_);
    s_.weight << Vector::Constant(dofs_, std::sqrt(K.maxCoeff())),
        Vector::Constant(dofs_, 1 / std::sqrt(inverse_.maxCoeff()));
  }
  void loads(double) {
    const double omega = 2 * std::numbers::pi / s_.period;
    s_.signals = {{}, {TimeSignal::Kind::sine, omega, d_.uniform(0, 6)}};
    if (d_.chance(0.4))
      s_.signals.push_back({TimeSignal::Kind::sine, omega * double(d_.index(2, 4)), d_.uniform(0, 6)});
    if (d_.chance(0.3))
      s_.signals.push_back(
          {TimeSignal::Kind::pulse, s_.period * d_.uniform(0, 1), s_.period, s_.period * d_.uniform(0.1, 0.7)});
    s_.F = Matrix::Zero(2 * dofs_, Index(s_.signals.size()));
    for (Index i = 0; i < dofs_; ++i)
      for (Index k = 0; k < s_.F.cols(); ++k)
        if (i == 0 || d_.chance(0.5)) s_.F.col(k) += push(i, force_ * d_.uniform(-1, 1) * (k == 0 ? 0.3 : 1));
    if (planar_) s_.F.col(0) -= push(dofs_ - 1, force_ * d_.uniform(0.2, 1.5));
  }
  void contacts_and_friction(Index masses, double rate) {
    Constraints add(s_);
    for (Index i = 0; i < masses; ++i) {
      for (const double side : {1.0, -1.0}) {
        if (!d_.chance(i == 0 ? 0.6 : 0.35)) continue;
        const double compliance = d_.chance(0.5) ? 0 : std::pow(10, -d_.uniform(0.5, 3)) / force_;
        add.add(push(i, side), position(i, side), d_.chance(0.2) ? 0 : d_.uniform(0, 0.7), compliance);
      }
      if (i > 0 && d_.chance(0.3)) {
        const Vector gap = position(i) - position(i - 1);
        add.add(push(i) - push(i - 1), gap, d_.uniform(0, 0.5), d_.chance(0.5) ? 0 : 0.02 / force_);
      }
      if (d_.chance(0.4)) belt(add, i, rate);
    }
    if (planar_) floor(add, rate);
    if (s_.constraints() == 0) add.add(push(0), position(0), 0.2);
  }
  double belt_speed(double rate) { return d_.chance(0.3) ? 0 : rate * d_.uniform(-0.6, 0.6); }
  /// |friction| <= R(t): y = (friction + R, the speed against the belt where negative), w = (v - V + y2, 2 R - y1).
  void belt(Constraints& add, Index i, double rate) {
    const double R = force_ * d_.uniform(0.1, 0.8), vary = d_.chance(0.3) ? R * d_.uniform(0.1, 0.9) : 0;
    const Index b = add.add(push(i), speed(i), -belt_speed(rate));
    const Index v = add.add(Vector::Zero(2 * dofs_), Vector::Zero(2 * dofs_), 2 * R);
    s_.M(b, v) = 1, s_.M(v, b) = -1;
    s_.F.col(0) -= push(i, R);
    s_.G(v, 1) = 2 * vary, s_.F.col(1) -= push(i, vary);
  }
  /// Contact with friction of the last mass on a moving floor: y = (normal force, friction + mu times it, as above).
  void floor(Constraints& add, double rate) {
    const Index t = dofs_ - 2, z = dofs_ - 1;
    const double mu = d_.uniform(0.1, 0.8),
                 compliance = d_.chance(0.5) ? 0 : std::pow(10, -d_.uniform(0.5, 3)) / force_;
    const Index c = add.add(push(z) - push(t, mu), position(z), 0, compliance);
    const Index b = add.add(push(t), speed(t), -belt_speed(rate));
    const Index v = add.add(Vector::Zero(2 * dofs_), Vector::Zero(2 * dofs_), 0);
    s_.M(b, v) = 1, s_.M(v, b) = -1, s_.M(v, c) = 2 * mu;
  }

  Draw& d_;
  EngineeringScene& s_;
  Matrix inverse_;
  Index dofs_ = 0;
  bool planar_ = false;
  double force_ = 0;
};

}  // namespace

EngineeringScene random_masses(std::uint32_t seed) {
  Draw draw(seed + 2000003);
  EngineeringScene s;
  s.name = "masses-" + std::to_string(seed);
  Chain(draw, s).make();
  return s;
}

EngineeringScene random_tanks(std::uint32_t seed) {
  Draw d(seed + 3000017);
  EngineeringScene s;
  s.name = "tanks-" + std::to_string(seed);
  const Index tanks = d.index(2, 6), flaps = d.chance(0.3) ? 1 : 0, m = tanks + flaps;
  const double hour = std::pow(10, d.uniform(-1, 3));  // x and its rates are of size 1 in this unit of time
  s.period = hour * d.uniform(1, 4), s.T = s.period * d.uniform(2, 5);
  s.signals = {{}, {TimeSignal::Kind::sine, 2 * std::numbers::pi / s.period, d.uniform(0, 6)}};
  if (d.chance(0.6))
    s.signals.push_back(
        {TimeSignal::Kind::pulse, s.period * d.uniform(0, 1), s.period, s.period * d.uniform(0.1, 0.8)});
  s.A = Matrix::Zero(m, m), s.F = Matrix::Zero(m, Index(s.signals.size()));
  s.weight = Vector::Ones(m), s.x0 = Vector::Zero(m);
  for (Index i = 0; i < tanks; ++i) {  // valves between neighbours, and outlets
    const double valve = i + 1 < tanks && d.chance(0.6) ? d.uniform(0.05, 1) / hour : 0;
    if (valve > 0) s.A(i, i) -= valve, s.A(i + 1, i + 1) -= valve, s.A(i, i + 1) += valve, s.A(i + 1, i) += valve;
    if (d.chance(0.5)) s.A(i, i) -= d.uniform(0.05, 0.6) / hour;
    s.x0[i] = d.chance(0.2) ? 0 : d.uniform(0, 1);
    for (Index k = 0; k < s.F.cols(); ++k)
      if (d.chance(0.6)) s.F(i, k) = d.uniform(-1, 1) / hour;
  }
  Constraints add(s);
  const auto one = [&](Index i) { return Vector(Vector::Unit(m, i)); };
  for (Index i = 0; i < tanks; ++i) {
    if (d.chance(0.8)) add.add(one(i) / hour, one(i), 0, d.chance(0.2) ? 0.05 : 0);  // never below 0
    if (d.chance(0.7)) {  // spills into the next tank, or out
      Vector spill = -one(i) / hour;
      if (i + 1 < tanks && d.chance(0.6)) spill += one(i + 1) / hour;
      add.add(spill, -one(i), d.uniform(1, 2), d.chance(0.2) ? 0.02 : 0);
    }
    if (i + 1 < tanks && d.chance(0.4)) {  // a check valve, with or without resistance
      const Index to = d.chance(0.5) ? i : i + 1, from = 2 * i + 1 - to;
      add.add((one(to) - one(from)) / hour, one(to) - one(from), d.chance(0.5) ? 0 : 0.2,
              d.chance(0.6) ? d.uniform(0.05, 1) : 0);
    }
  }
  if (flaps > 0) {  // a pipe with inertia, whose flap lets nothing back
    const Index to = d.index(1, tanks - 1), pipe = tanks;
    const double inertia = hour * hour * d.uniform(0.02, 0.5);
    s.A(pipe, 0) = 1 / inertia, s.A(pipe, to) = -1 / inertia, s.A(pipe, pipe) = -hour * d.uniform(0, 0.3) / inertia;
    s.A(0, pipe) -= 1, s.A(to, pipe) += 1;
    s.weight[pipe] = hour;
    add.add(one(pipe) / inertia, one(pipe), 0);
  }
  if (s.constraints() == 0) add.add(one(0) / hour, one(0), 0);
  return s;
}

}  // namespace bromwich::oracle
