// Radau IIA as collocation, and the location of zeros, against polynomials in closed form and dense sampling.

#include "core/events/collocation.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <random>

namespace bromwich {
namespace {

constexpr Index s = Collocation::degree;

// Coefficients of a function by its values at the samples; exact for polynomials of degree s.
template <typename Function>
Vector coefficients_of(const Function& f) {
  const Collocation& c = Collocation::get();
  Vector values(s + 1);
  for (Index k = 0; k <= s; ++k) values[k] = f(c.samples[k]);
  return c.from_samples * values;
}

TEST(Collocation, HasTheRadauPoints) {
  // A quadrature with s points that is exact to degree 2 s - 2 and has a point at 1 is Radau's.
  const Collocation& c = Collocation::get();
  EXPECT_EQ(c.nodes[s - 1], 1);
  const Matrix A = c.integrals.leftCols(s) * c.stages.leftCols(s).inverse();
  for (int degree = 0; degree <= 2 * s - 2; ++degree) {
    const Vector power = c.nodes.array().pow(double(degree));
    EXPECT_NEAR(A.row(s - 1).dot(power), 1 / double(degree + 1), 1e-14) << degree;
  }
  const Vector beyond = c.nodes.array().pow(double(2 * s - 1));
  EXPECT_GT(std::abs(A.row(s - 1).dot(beyond) - 1 / double(2 * s)), 1e-10);
}

TEST(Collocation, IsExactForPolynomials) {
  const Collocation& c = Collocation::get();
  for (int degree = 0; degree <= s; ++degree) {
    const auto power = [degree](double t) { return std::pow(t, degree); };
    const Vector p = coefficients_of(power);
    const Vector d = c.derivative * p, b = c.bernstein * p;
    for (const double t : {0.0, 0.13, 0.5, 0.77, 1.0}) {
      EXPECT_NEAR(p.dot(legendre(t)), power(t), 1e-14);
      EXPECT_NEAR(p.dot(legendre_integrals(t)), std::pow(t, degree + 1) / (degree + 1), 1e-14);
      EXPECT_NEAR(d.dot(legendre(t)), degree == 0 ? 0 : degree * std::pow(t, degree - 1), 1e-12);
      double sum = 0;
      for (Index k = 0; k <= s; ++k)
        sum += b[k] * std::exp(std::lgamma(s + 1.0) - std::lgamma(double(k) + 1) - std::lgamma(double(s - k) + 1)) *
               std::pow(t, double(k)) * std::pow(1 - t, double(s - k));
      EXPECT_NEAR(sum, power(t), 1e-12);
    }
    Vector values(s + 1);
    values << power(0), c.nodes.unaryExpr([&](double t) { return power(t); });
    EXPECT_LE((c.coefficients * values - p).cwiseAbs().maxCoeff(), 1e-13);
  }
}

// R(z) = 1 + z b^T (I - z A)^{-1} 1 by the eigenvalues that a step uses.
double stability(double z) {
  const Collocation& c = Collocation::get();
  double end = 0;
  for (const auto& e : c.eigenvalues) end += e.weight * (e.right[s - 1] * e.left.sum() / (1.0 - z * e.value)).real();
  return end;
}

TEST(Collocation, IsOfOrder13AndLStable) {
  // R is the (s-1, s) Pade approximation of e^z: R(z) - e^z = O(z^(2s)), with the constant s! (s-1)! / ((2s-1)! (2s)!).
  const double constant =
      std::tgamma(s + 1.0) * std::tgamma(double(s)) / (std::tgamma(2.0 * s) * std::tgamma(2.0 * s + 1));
  for (const double z : {-2.0, -3.0, -4.0}) {
    const double error = std::abs(stability(z) - std::exp(z)), bound = constant * std::pow(-z, 2.0 * s);
    EXPECT_LE(error, bound + 1e-14) << z;
    EXPECT_GE(error, 0.9 * std::exp(z) * bound - 1e-14) << z;  // the mean of e^(zu), u in [0, 1], is larger
  }
  for (const double z : {-1e1, -1e3, -1e6, -1e12}) EXPECT_LE(std::abs(stability(z)), 1);
  EXPECT_LE(std::abs(stability(-1e12)), 1e-9);
}

// ---- zeros ----

constexpr int grid = 4000;

double first_below_by_sampling(const Vector& p, double noise) {
  for (int k = 0; k <= grid; ++k)
    if (p.dot(legendre(double(k) / grid)) < -noise) return double(k) / grid;
  return 1;
}

TEST(FirstBelow, AgreesWithSampling) {
  std::mt19937 draw(1);
  std::uniform_real_distribution<double> in(-1, 1);
  for (int trial = 0; trial < 30; ++trial) {
    Vector p(s + 1);
    for (Index k = 0; k <= s; ++k) p[k] = in(draw) / double(k + 1);
    p[0] += 0.8;
    const Vector b = Collocation::get().bernstein * p;
    const double sampled = first_below_by_sampling(p, 1e-9), found = first_below(b, 1e-9);
    EXPECT_LE(found, sampled + 1e-12) << trial;
    if (found < 1) {
      EXPECT_NEAR(p.dot(legendre(found)), std::min(-1e-9, p.dot(legendre(0))), 1e-12) << trial;
      EXPECT_LE(sampled - found, 2.0 / grid) << trial;
    } else {
      EXPECT_EQ(sampled, 1) << trial;
    }
  }
}

TEST(FirstBelow, OfTangentPolynomials) {
  for (const double at : {0.1, 0.37, 0.9}) {
    const auto touching = [at](double lift) {
      return coefficients_of([=](double t) { return (t - at) * (t - at) * (1 + t) + lift; });
    };
    const Matrix& to_bernstein = Collocation::get().bernstein;
    EXPECT_EQ(first_below(to_bernstein * touching(0), 1e-12), 1);
    EXPECT_EQ(first_below(to_bernstein * touching(-0.9e-10), 1e-10), 1);
    // (t - at)^2 (1 + t) = 1e-8: t = at - 1e-4 / sqrt(1 + t).
    const double first = first_below(to_bernstein * touching(-1e-8 - 1e-12), 1e-12);
    EXPECT_NEAR(first, at - 1e-4 / std::sqrt(1 + at), 1e-8);
  }
  EXPECT_EQ(first_below(Vector::Constant(s + 1, -1.0), 1e-9), 0);
  EXPECT_EQ(first_below(Vector::Zero(s + 1), 0), 1);
}

TEST(ZeroBefore, IsWhereThePolynomialChangesSign) {
  for (const double zero : {0.01, 0.2, 0.6, 0.95}) {
    const Vector p = coefficients_of([zero](double t) { return (zero - t) * (2 + t * t); });
    EXPECT_NEAR(zero_before(p, std::min(1.0, zero + 1e-6)), zero, 1e-14);
    EXPECT_NEAR(zero_before(p, zero + 0.03), zero, 1e-14);
  }
  const Vector negative = coefficients_of([](double t) { return -1 - t; });
  EXPECT_EQ(zero_before(negative, 0.4), 0) << "it is where the polynomial begins";
  const Vector positive = coefficients_of([](double t) { return 1 + t; });
  EXPECT_EQ(zero_before(positive, 0.4), 0.4);
}

}  // namespace
}  // namespace bromwich
