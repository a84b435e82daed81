// Published pairs of the Laplace transform (Abramowitz, Stegun, Handbook of Mathematical Functions, 29.3) over six
// decades.

#include "bromwich/laplace_inversion.hpp"
#include "core/base/error.hpp"
#include "core/numerics/inversion_rule.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

using C = Complex;

struct Pair {
  const char* name;
  C (*F)(C);
  double (*f)(double);
  std::vector<C> singularities;
  double t1 = 1e3;  ///< beyond it f underflows, or F is ill-conditioned
  /// |f| falls below the rounding of its terms: the error is compared with this, and not with f.
  double scale = 0;
};

C root(C s) { return std::sqrt(s - C(0, 1)) * std::sqrt(s + C(0, 1)); }

const std::vector<Pair>& pairs() {
  static const std::vector<Pair> all{
      {"1/s", [](C s) { return 1.0 / s; }, [](double) { return 1.0; }, {}},
      {"1/s^2", [](C s) { return 1.0 / (s * s); }, [](double t) { return t; }, {}},
      {"s^-4", [](C s) { return 1.0 / (s * s * s * s); }, [](double t) { return t * t * t / 6; }, {}},
      {"s^-1/2",
       [](C s) { return 1.0 / std::sqrt(s); },
       [](double t) { return 1 / std::sqrt(std::numbers::pi * t); },
       {}},
      {"s^-3/2",
       [](C s) { return 1.0 / (s * std::sqrt(s)); },
       [](double t) { return 2 * std::sqrt(t / std::numbers::pi); },
       {}},
      {"1/(s+1)", [](C s) { return 1.0 / (s + 1.0); }, [](double t) { return std::exp(-t); }, {-1.0}, 600},
      {"1/(s+1)^2",
       [](C s) { return 1.0 / ((s + 1.0) * (s + 1.0)); },
       [](double t) { return t * std::exp(-t); },
       {-1.0},
       600},
      {"1/(s(s+1))", [](C s) { return 1.0 / (s * (s + 1.0)); }, [](double t) { return -std::expm1(-t); }, {}},
      // Rounding of omega t at t = 1000 is 1000 eps of the amplitude.
      {"1/(s^2+1)", [](C s) { return 1.0 / (s * s + 1.0); }, [](double t) { return std::sin(t); }, {C(0, 1)}, 1e3, 0.1},
      {"s/(s^2+1)", [](C s) { return s / (s * s + 1.0); }, [](double t) { return std::cos(t); }, {C(0, 1)}, 1e3, 0.1},
      {"e^-sqrt(s)/s",
       [](C s) { return std::exp(-std::sqrt(s)) / s; },
       [](double t) { return std::erfc(0.5 / std::sqrt(t)); },
       {},
       1e3,
       1e-2},
      {"J0", [](C s) { return 1.0 / root(s); }, [](double t) { return std::cyl_bessel_j(0, t); }, {C(0, 1)}, 30, 0.1},
      {"log(s)/s",
       [](C s) { return std::log(s) / s; },
       [](double t) { return -std::log(t) - std::numbers::egamma; },
       {},
       1e3,
       0.1},
      {"1/(s-1)", [](C s) { return 1.0 / (s - 1.0); }, [](double t) { return std::exp(t); }, {1.0}, 600},
      {"1/(s^2-1)", [](C s) { return 1.0 / (s * s - 1.0); }, [](double t) { return std::sinh(t); }, {1.0}, 600},
      {"I0",
       [](C s) { return 1.0 / (std::sqrt(s - 1.0) * std::sqrt(s + 1.0)); },
       [](double t) { return std::cyl_bessel_i(0, t); },
       {1.0},
       30},
  };
  return all;
}

LaplaceTransform of_each(C (*F)(C)) {
  return [F](const ComplexVector& s) { return ComplexMatrix(s.unaryExpr([F](C z) { return F(z); })); };
}

Vector decades(double t1) {
  Vector t(200);
  for (Index i = 0; i < 200; ++i) t[i] = 1e-3 * std::pow(t1 / 1e-3, double(i) / 199);
  return t;
}

TEST(LaplaceInversion, PublishedPairsOverSixDecades) {
  for (const Pair& pair : pairs()) {
    const Vector t = decades(pair.t1);
    const LaplaceInverse inverse = invert_laplace(of_each(pair.F), t, {.singularities = pair.singularities});
    for (Index i = 0; i < t.size(); ++i) {
      const double exact = pair.f(t[i]), error = std::abs(inverse.f(i, 0) - exact);
      // The functions of the C++ library that are the references have errors of some roundings themselves, J0 and I0 of
      // 100.
      EXPECT_LE(error, 1e-12 * std::max(std::abs(exact), pair.scale)) << pair.name << " at " << t[i];
      EXPECT_LE(error, inverse.error(i, 0) + 1e-14 * std::abs(exact) + 1e-15 * pair.scale)
          << pair.name << " at " << t[i];
      EXPECT_LE(inverse.error(i, 0), 1e-9 * std::max(std::abs(exact), pair.scale)) << pair.name << " at " << t[i];
    }
  }
}

// Singularities that were not given: the contours of large t leave them out, and no error estimate says so by itself.
TEST(LaplaceInversion, OtherSingularitiesMakeTheErrorInfinite) {
  const Vector t{{1e-2, 50.0}};
  for (C (*F)(C) : {+[](C s) { return 1.0 / (s - 1.0); }, +[](C s) { return 1.0 / (s * s + 1.0); },
                    +[](C s) { return 1.0 / s + 1e-4 / (s - 0.5); }, +[](C s) { return 1.0 / root(s); }}) {
    const LaplaceInverse inverse = invert_laplace(of_each(F), t);
    EXPECT_LT(inverse.error(0, 0), 1e-9);
    EXPECT_EQ(inverse.error(1, 0), INFINITY);
  }
  const LaplaceInverse alone = invert_laplace(of_each([](C s) { return 1.0 / (s - 1.0); }), Vector{{50.0}});
  EXPECT_EQ(alone.error(0, 0), INFINITY);
}

// Cuts up and down, a jump at t = 1, and poles along the imaginary axis: errors are no smaller than they are.
TEST(LaplaceInversion, HardTransformsHaveHonestErrors) {
  const Vector t = decades(1e3);
  const auto error_holds = [&](C (*F)(C), double (*f)(double), const InversionOptions& options) {
    const LaplaceInverse inverse = invert_laplace(of_each(F), t, options);
    for (Index i = 0; i < t.size(); ++i)
      if (std::isfinite(inverse.error(i, 0))) {
        EXPECT_LE(std::abs(inverse.f(i, 0) - f(t[i])), inverse.error(i, 0)) << t[i];
      }
    return inverse;
  };
  const auto J0 = [](double at) { return std::cyl_bessel_j(0, at); };
  const auto cut = error_holds([](C s) { return 1.0 / std::sqrt(s * s + 1.0); }, J0, {.singularities = {C(0, 1)}});
  EXPECT_EQ(cut.error.minCoeff(), INFINITY);
  error_holds([](C s) { return std::exp(-s) / s; }, [](double at) { return at > 1 ? 1.0 : 0.0; }, {});
  error_holds([](C s) { return std::tanh(s / 2.0) / s; },
              [](double at) { return 1 - 2 * std::fmod(std::floor(at), 2); }, {});
}

TEST(LaplaceInversion, TalbotAgreesAndTakesOneHalfLine) {
  const Vector t = decades(1e3);
  InversionOptions options;
  options.contour = InversionContour::talbot;
  const LaplaceInverse inverse = invert_laplace(of_each([](C s) { return 1.0 / std::sqrt(s); }), t, options);
  for (Index i = 0; i < t.size(); ++i) {
    const double exact = 1 / std::sqrt(std::numbers::pi * t[i]);
    EXPECT_LE(std::abs(inverse.f(i, 0) - exact), inverse.error(i, 0));
    EXPECT_LE(inverse.error(i, 0), 1e-9 * exact);
  }
  options.singularities = {C(0, 1)};
  EXPECT_THROW(invert_laplace(of_each([](C s) { return 1.0 / s; }), t, options), Error);
}

// (sI - A)^{-1} of a rotation is e^{At}, and a complex original has no symmetry.
TEST(LaplaceInversion, ComponentsAndComplexOriginals) {
  const Vector t = decades(30);
  const LaplaceTransform resolvent = [](const ComplexVector& s) {
    ComplexMatrix value(s.size(), 2);
    value.col(0) = s.array() / (s.array().square() + 1);
    value.col(1) = 1 / (s.array().square() + 1);
    return value;
  };
  const LaplaceInverse rotation = invert_laplace(resolvent, t, {.singularities = {C(0, 1)}});
  const LaplaceInverse complex = invert_laplace(of_each([](C s) { return 1.0 / (s - C(-0.1, 2)); }), t,
                                                {.singularities = {C(-0.1, 2)}, .real = false});
  for (Index i = 0; i < t.size(); ++i) {
    EXPECT_NEAR(rotation.f(i, 0).real(), std::cos(t[i]), 1e-13);
    EXPECT_NEAR(rotation.f(i, 1).real(), std::sin(t[i]), 1e-13);
    EXPECT_LE(std::abs(complex.f(i, 0) - std::exp(C(-0.1, 2) * t[i])), 1e-13);
  }
}

TEST(LaplaceInversion, BadInput) {
  const auto F = of_each([](C s) { return 1.0 / s; });
  for (const double bad : {0.0, -1.0, double(NAN), double(INFINITY)})
    EXPECT_THROW(invert_laplace(F, Vector{{1.0, bad}}), Error);
  EXPECT_THROW(invert_laplace(F, Vector{{1.0}}, {.singularities = {C(NAN, 0)}}), Error);
  EXPECT_THROW(invert_laplace({}, Vector{{1.0}}), Error);
  EXPECT_THROW(invert_laplace([](const ComplexVector&) { return ComplexMatrix(1, 1); }, Vector{{1.0}}), Error);
  EXPECT_EQ(invert_laplace(F, Vector(0)).f.rows(), 0);
}

// Twice the half-height needs about twice the nodes, and a window alone fewer than the two of its halves.
TEST(LaplaceInversion, NodesOfHyperbolas) {
  const InversionAccuracy accuracy;
  const auto nodes = [&](double height, double ratio) { return inversion_hyperbola(height, ratio, accuracy)->nodes; };
  EXPECT_LT(nodes(0, 100), 2 * nodes(0, 10));
  EXPECT_LT(nodes(200, 3), 3 * nodes(100, 3));
  EXPECT_FALSE(inversion_hyperbola(1e7, 3, accuracy));
}

}  // namespace
}  // namespace bromwich
