#pragma once
// Structures with contacts of the tests, and of studies.

#include "mechanics/mechanism.hpp"

#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <utility>
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

/// A loose wheel of a helical pair, in coordinates that turn with the other one: its rotation r between two flanks, and
/// its axial place z on a bearing. Teeth slide along each other with 0.3. The other wheel does not turn evenly.
inline Mechanism rattling_gear(double mu, double e, double T) {
  constexpr double play = 0.3;
  Structure s;
  const Matrix K{{0.2, -0.5}, {-0.5, 2}};
  s.M = sparse(Matrix::Identity(2, 2)), s.K = sparse(K), s.C = sparse(Matrix(0.1 * Matrix::Identity(2, 2)));
  s.f = forces([](double t) { return Vector{{2 * std::cos(2 * t), 0}}; });
  s.T = T;
  s.breakpoints_are_all = true;
  std::vector<Contact> flanks(2);
  for (const auto& [flank, side] : {std::pair(&flanks[0], 1.0), {&flanks[1], -1.0}}) {
    flank->normal = Vector{{side, 0}};
    flank->gap = always(play);
    flank->tangent = Matrix{{0, 1}};
    flank->velocity = always(0.3);
    flank->mu = mu, flank->restitution = e;
  }
  return make_mechanism(s, flanks);
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

struct DrawnStructure {
  Structure structure;
  std::vector<Contact> contacts;
};

/// Planar structures that rest, strike, stick and slip. `spare`: coordinates without contacts, fewer than that.
/// `compliant`: a quarter of the contacts is.
inline DrawnStructure random_structure(std::uint32_t seed, Index contacts, Index spare, bool compliant,
                                       const std::vector<double>& frictions) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const auto pick = [&](const std::vector<double>& values) { return values[random() % values.size()]; };
  const auto draw = [&](Index rows, Index cols) {
    Matrix m(rows, cols);
    for (double& value : m.reshaped()) value = normal(random);
    return m;
  };
  const Index d = 2 * contacts + Index(random() % std::size_t(spare));
  DrawnStructure drawn;
  Structure& s = drawn.structure;
  const Matrix R = draw(d, d), S = draw(d, d), I = Matrix::Identity(d, d);
  s.M = sparse(random() % 2 ? I : Matrix(I + 0.3 * R * R.transpose() / double(d)));
  s.K = sparse(Matrix(S * S.transpose() / double(d) + I));
  s.C = sparse(Matrix(0.05 * I + 0.02 * Matrix(s.K)));
  const Vector a = draw(d, 1), b = 0.7 * draw(d, 1), phase = 3 * draw(d, 1);
  const double rate = 1 + double(random() % 300) / 100;
  s.f = forces([=](double t) { return Vector(a.array() * (rate * t + phase.array()).sin() + b.array()); });
  s.T = 4;
  s.breakpoints_are_all = true;
  for (Index i = 0; i < contacts; ++i) {
    Contact c;
    const bool along = random() % 2;
    c.normal = along ? Vector(Vector::Unit(d, 2 * i + 1)) : Vector(draw(d, 1).normalized());
    c.mu = pick(frictions);
    if (c.mu > 0) {
      c.tangent = along ? Matrix(Vector::Unit(d, 2 * i).transpose()) : Matrix(draw(1, d).normalized());
      c.velocity = always(pick({0, 0.4, -0.7}));
    }
    c.gap = always(pick({0, 0.05, 0.3}));
    if (compliant && random() % 4 == 0)
      c.kn = pick({10, 100});
    else
      c.restitution = pick({0, 0, 0.3, 0.6, 0.9});
    drawn.contacts.push_back(c);
  }
  return drawn;
}

inline TimeFunction turned(const TimeFunction& of) {
  return forces([of](double t) {
    Vector value(1);
    of(t, value);
    return Vector(-value);
  });
}

/// Coordinates with other signs, and tangents with other signs: the same motion.
inline DrawnStructure mirrored(const DrawnStructure& drawn, const Vector& signs) {
  DrawnStructure image = drawn;
  for (SparseMatrix* m : {&image.structure.M, &image.structure.C, &image.structure.K})
    *m = sparse(Matrix(signs.asDiagonal() * Matrix(*m) * signs.asDiagonal()));
  image.structure.f = forces([f = drawn.structure.f, signs](double t) {
    Vector value(signs.size());
    f(t, value);
    return Vector(signs.cwiseProduct(value));
  });
  if (image.structure.v0.size() > 0) image.structure.v0 = signs.cwiseProduct(drawn.structure.v0);
  for (Contact& c : image.contacts) {
    c.normal = c.normal.cwiseProduct(signs).eval();
    if (c.tangent.size() == 0) continue;
    c.tangent = (-c.tangent * signs.asDiagonal()).eval();
    c.velocity = turned(c.velocity);
  }
  return image;
}

/// Signs that are no pattern of the structure.
inline Vector drawn_signs(std::uint32_t seed, Index d) {
  Vector signs(d);
  for (Index i = 0; i < d; ++i) signs[i] = (seed >> (i % 5)) % 2 == 0 ? -1 : 1;
  return signs;
}

}  // namespace bromwich
