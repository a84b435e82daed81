// Uniqueness against all principal minors of the problem of velocities, and against cases with an answer of their own.

#include "core/lcp/lcp_class.hpp"
#include "mechanics/uniqueness.hpp"
#include "tests/mechanics/mechanisms.hpp"

#include <gtest/gtest.h>

#include <random>
#include <utility>

namespace bromwich {
namespace {

Mechanism rod(double mu) {
  const double a = 1 / std::sqrt(2);
  Structure s;
  s.M = sparse(Matrix(Vector{{1, 1, 1.0 / 3}}.asDiagonal()));
  Contact c;
  c.normal = Vector{{0, 1, -a}};
  c.tangent = Matrix{{1, 0, a}};
  c.mu = mu;
  return make_mechanism(s, {c});
}

// Wnn = 1 + 3/2 and Wnt = -3/2: mu < 5/3.
TEST(Uniqueness, OfARod) {
  EXPECT_EQ(uniqueness(rod(1.6)), Uniqueness::unique);
  EXPECT_EQ(uniqueness(rod(1.7)), Uniqueness::none_known);
}

TEST(Uniqueness, TwoStopsWithOneTangentShareFriction) {
  Contact other = belt();
  other.normal = Vector{{0, -1}};
  other.gap = always(1);
  EXPECT_EQ(uniqueness(make_mechanism(block(0.6, 1), {belt(), other})), Uniqueness::forces_open);
  other.kn = 100;  // its friction still shares the tangent
  EXPECT_EQ(uniqueness(make_mechanism(block(0.6, 1), {belt(), other})), Uniqueness::forces_open);
  other.kt = 100;
  EXPECT_EQ(uniqueness(make_mechanism(block(0.6, 1), {belt(), other})), Uniqueness::unique);
}

// Eight blocks on the ground, whose masses couple the tangent of each with the normals of its neighbours by w = 0.15.
// With mu = 0.1 all maps are dominated by their diagonals. Two neighbours that slip have about 1 - mu mu' w^2.
TEST(Uniqueness, OfEightContacts) {
  constexpr Index d = 16;
  Matrix mass = Matrix::Identity(d, d);
  for (Index i = 0; i + 2 < d; i += 2)
    for (const auto [tangent, normal] : {std::pair(i, i + 3), {i + 2, i + 1}})
      mass(tangent, normal) = mass(normal, tangent) = 0.15;
  Structure s;
  s.M = sparse(mass);
  const auto blocks = [&](double mu) {
    std::vector<Contact> all;
    for (Index i = 0; i < d; i += 2) {
      Contact c;
      c.normal = Vector::Unit(d, i + 1), c.tangent = Vector::Unit(d, i).transpose();
      c.mu = i == 8 ? mu : 0.1;
      all.push_back(c);
    }
    return uniqueness(make_mechanism(s, all));
  };
  EXPECT_EQ(blocks(0.1), Uniqueness::unique);
  EXPECT_EQ(blocks(1000), Uniqueness::none_known);
}

// The matrix of the problem in velocities with eps on the slip rows is of class P, or not, for random contacts.
TEST(Uniqueness, IsClassPOfThePerturbedProblem) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  int unique = 0;
  constexpr int trials = 60;
  for (int trial = 0; trial < trials; ++trial) {
    constexpr Index d = 7;
    const Index contacts = 1 + trial % 3;
    Matrix R(d, d);
    for (double& r : R.reshaped()) r = normal(random);
    Structure s;
    const Matrix mass = R * R.transpose() + 0.5 * Matrix::Identity(d, d);
    s.M = sparse(mass);
    std::vector<Contact> all;
    Matrix N = Matrix::Zero(3 * contacts, d), B = Matrix::Zero(d, 3 * contacts),
           M = Matrix::Zero(3 * contacts, 3 * contacts);
    for (Index i = 0; i < contacts; ++i) {
      Contact c;
      c.normal = Vector(d), c.tangent = Matrix(1, d);
      for (double& v : c.normal) v = normal(random);
      for (double& v : c.tangent.reshaped()) v = normal(random);
      c.mu = std::abs(normal(random));
      N.row(3 * i) = c.normal.transpose(), N.row(3 * i + 1) = c.tangent.row(0);
      B.col(3 * i) = c.normal - c.mu * c.tangent.row(0).transpose();
      B.col(3 * i + 1) = c.tangent.row(0).transpose();
      M(3 * i + 1, 3 * i + 2) = 1, M(3 * i + 2, 3 * i) = 2 * c.mu, M(3 * i + 2, 3 * i + 1) = -1;
      M(3 * i + 2, 3 * i + 2) = 1e-7;
      all.push_back(c);
    }
    const bool P = is_P_exact(Matrix(M + N * mass.inverse() * B));
    unique += P;
    EXPECT_EQ(uniqueness(make_mechanism(s, all)), P ? Uniqueness::unique : Uniqueness::none_known) << trial;
  }
  EXPECT_GT(unique, trials / 5);
  EXPECT_LT(unique, trials - trials / 5);
}

}  // namespace
}  // namespace bromwich
