// Shared hyperbolas reproduce e^{at} over whole windows and sectors; the literal contour has its printed rate.

#include "core/kernel/kernel.hpp"
#include "core/numerics/contour.hpp"
#include "core/numerics/phi.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

constexpr double degree = std::numbers::pi / 180;

/// Every entry of the stored table.
std::vector<ContourParameters> stored() {
  std::vector<ContourParameters> all{*contour_parameters(0, 1e-12)};
  for (const double angle : {0., 15., 30., 45., 60.}) all.push_back(*contour_parameters(angle * degree));
  return all;
}

/// Σ_p c_p e^{z_p t}/(z_p - a) over both halves of the contour.
Complex inverted(const Contour& contour, Complex a, double t) {
  Complex sum = 0;
  for (Index p = 0; p < contour.nodes.size(); ++p) {
    const Complex z = contour.nodes[p], c = contour.weights[p];
    sum += 0.5 * (c * std::exp(z * t) / (z - a) + std::conj(c * std::exp(z * t)) / (std::conj(z) - a));
  }
  return sum;
}

TEST(Contour, ReproducesExponentialsOverWindowAndSector) {
  for (const ContourParameters& parameters : stored())
    for (const double t0 : {1.0, 3e-4}) {
      const Contour contour = window_contour(parameters, t0);
      double worst = 0;
      for (const double part : {-1.0, -0.5, 0.0, 0.5, 1.0})
        for (int i = -1; i <= 110; ++i) {
          const double modulus = i < 0 ? 0 : 1e-4 * std::pow(10.0, i / 10.0) / t0;  // 0, 1e-4 to 1e7
          const Complex a = -std::polar(modulus, part * parameters.half_angle);
          for (int k = 0; k <= 40; ++k) {
            const double t = t0 * std::pow(window_ratio, k / 40.0);
            worst = std::max(worst, std::abs(inverted(contour, a, t) - std::exp(a * t)));
          }
        }
      // The stored error is the maximum over a coarser grid of a and t; between its points errors are at most 4 times
      // larger.
      EXPECT_LE(worst, 4 * parameters.error) << parameters.half_angle / degree << " degrees, P = " << parameters.P;
    }
}

TEST(Contour, FewNodesForRealSpectra) {
  const auto parameters = contour_parameters(0, 1e-12);
  ASSERT_TRUE(parameters);
  EXPECT_LE(parameters->P + 1, 22);
  EXPECT_LE(parameters->error, 1e-12);
  EXPECT_LE(parameters->P, contour_parameters(0, 1e-14)->P);
}

TEST(Contour, ChoosesTheSmallestSectorThatHolds) {
  Index before = 0;
  for (const double angle : {0.0, 1e-9, 15 * degree, 15.1 * degree, 45 * degree, 60 * degree}) {
    const auto parameters = contour_parameters(angle);
    ASSERT_TRUE(parameters) << angle;
    EXPECT_GE(parameters->half_angle, angle);
    EXPECT_LE(parameters->error, 1e-14);
    EXPECT_GE(parameters->P, before);
    before = parameters->P;
  }
  EXPECT_EQ(contour_parameters(15 * degree)->half_angle, 15 * degree);
}

TEST(Contour, RefusesWhatItCannotHold) {
  EXPECT_FALSE(contour_parameters(60.1 * degree));
  EXPECT_FALSE(contour_parameters(std::numbers::pi / 2));
  EXPECT_FALSE(contour_parameters(std::numbers::pi));
  EXPECT_FALSE(contour_parameters(0, 1e-16));
  EXPECT_FALSE(contour_parameters(0, 0));
  EXPECT_FALSE(contour_parameters(std::numeric_limits<double>::quiet_NaN()));
}

TEST(Contour, LagWindowsCover) {
  const ContourParameters parameters = *contour_parameters(0);
  const double h = 0.01;
  for (const Index J : {0, 1, 2, 4, 5, 19, 400, 4096}) {
    Index next = 0;
    for (const LagWindow& w : lag_windows(parameters, h, J)) {
      EXPECT_EQ(w.first, next) << J;
      EXPECT_EQ(w.F.rows(), w.last - w.first + 1);
      EXPECT_EQ(w.contour.nodes.size(), parameters.P + 1);
      // Lag d is an integral over [(d-1)h, (d+1)h]; for lags 0 and 1 only [h, 2h] remains.
      EXPECT_LE(w.contour.t0, h * double(std::max<Index>(w.first - 1, 1)) * (1 + epsilon)) << J;
      EXPECT_GE(w.contour.t1, h * double(w.last + 1) * (1 - 4 * epsilon)) << J;
      next = w.last + 1;
    }
    EXPECT_EQ(next, J + 1);
  }
}

// Any spectrum of radius rho, on both sides of the axis: residues of phi-functions at the eigenvalues.
TEST(Circle, GivesEntireFunctionsOnAnySpectrum) {
  const double h = 0.1;
  for (const double rho : {0.0, 1.0, 20.0, 80.0}) {
    const Contour contour = *circle(rho, h);
    for (int i = 0; i < 12; ++i) {
      const Complex a = std::polar(rho, 0.55 * double(i));
      Complex sum = 0;  // real data: the eigenvalue comes with its conjugate
      for (Index p = 0; p < contour.nodes.size(); ++p) {
        const Complex z = contour.nodes[p], value = contour.weights[p] * bromwich::phi2(h * z);
        sum += 0.5 * (value / (z - a) + value / (z - std::conj(a))).real();
      }
      // Rounding: eps times the largest |phi_2| on the circle.
      const double largest = std::exp(h * std::abs(contour.nodes[0]));
      EXPECT_NEAR(sum.real(), bromwich::phi2(h * a).real(), 20 * epsilon * largest) << rho << ' ' << i;
    }
  }
  EXPECT_FALSE(circle(91, h));
  EXPECT_FALSE(circle(std::numeric_limits<double>::quiet_NaN(), h));
}

/// Σ_p c_p/(z_p - a) ∫_0^t e^{z_p (t-s)} ds; the exact value is (e^{at} - 1)/a. Theorem 2.3 (2) bounds the error.
double literal_scalar_response(double a, double t, Index P) {
  const Contour contour = literal_contour(P, t);
  double sum = 0;
  for (Index p = 0; p <= P; ++p) {
    const Complex z = contour.nodes[p];
    sum += (contour.weights[p] / (z - a) * t * bromwich::phi1(z * t)).real();
  }
  return sum;
}

TEST(LiteralContour, HasThePrintedRate) {
  for (const Index P : {4, 9, 16, 25, 36, 49, 64, 81, 100}) {
    double worst = std::abs(literal_scalar_response(0, 1, P) - 1), where = 0;
    for (int i = 0; i <= 600; ++i) {
      const double a = -std::pow(10.0, -2 + i / 100.0);
      const double error = std::abs(literal_scalar_response(a, 1, P) - std::expm1(a) / a);
      if (error > worst) worst = error, where = a;
    }
    const double root = std::sqrt(double(P)), printed = std::exp(-2.06 * root) / root;
    // (2.8) is a rate; its constant is below 4 for all a <= 0 tested, and the rate is nearly sharp.
    EXPECT_LE(worst, 4 * printed) << "P = " << P << ", a = " << where;
    EXPECT_GE(worst, printed / 4) << "P = " << P;
  }
}

TEST(LiteralContour, ScalesWithTime) {
  // Only a t matters: the response over [0, t] is t times that over [0, 1].
  for (const double t : {1e-3, 0.7, 40.0})
    EXPECT_NEAR(literal_scalar_response(-2 / t, t, 25) / t, literal_scalar_response(-2, 1, 25), 1e-13);
}

}  // namespace
}  // namespace bromwich
