// Transfer functions as sums of few poles, against themselves and against lag weights formed without the fit.

#include "core/kernel/transfer_fit.hpp"

#include "catalogue/catalogue.hpp"
#include "core/dynamics/line_transfer.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "core/kernel/recurrence.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

const KroneckerDynamics& heat_of(const Scene& scene) { return get<KroneckerDynamics>(scene.dynamics); }

/// Largest error of the sum at z, relative to the largest of the given values.
double pole_sum_error(const PoleSum& sum, const ComplexVector& values, Complex z) {
  ComplexVector found = (sum.constant + 0 * sum.linear).cast<Complex>() + z * sum.linear.cast<Complex>();
  for (Index k = 0; k < sum.rates.size(); ++k)
    found += sum.coefficients.row(k).transpose().cast<Complex>() / (z - sum.rates[k]);
  return (found - values).cwiseAbs().maxCoeff() / values.cwiseAbs().maxCoeff();
}

TEST(TransferFit, HoldsWhereTheRuleLooks) {
  for (const bool radau : {false, true})
    for (const double c : {0.002, 1.}) {
      const Scene scene = make_scene("contact", {{"Q", 63}, {"c", c}});
      const KroneckerDynamics& d = heat_of(scene);
      const LineTransfer line(d.across, d.n, d.b);
      const Vector mu = d.along.eigenvalues(), nu = d.across.eigenvalues();
      const double h = scene.T / 512;
      const TransferFunctions both = [&](Complex z) -> ComplexVector {
        ComplexVector v(2);
        v << 1.0 / line(z), 1.0 / (0.1 + line(z));
        return v;
      };
      const FitRegion region{radau, h, scene.T, -mu.maxCoeff(), -mu.minCoeff()};
      const PoleSum sum = fit_poles(both, 2, region, -0.3 * nu.maxCoeff(), 4 * std::max(-nu.minCoeff(), 2 / h), true);
      ASSERT_EQ(sum.functions(), 2);
      EXPECT_LE(sum.error, accepted_fit_error);
      EXPECT_LE(sum.rates.maxCoeff(), 0);
      // Implicit Euler at the mode l looks at z = (1 - zeta)/h - mu_l, |zeta| <= 1. The fit is measured relative to the
      // larger function; 4 covers points between its check points.
      for (const double radius : {1., 0.6, 0.})
        for (const Index l : {Index(0), Index(5), Index(62)})
          for (const double angle : {0.01, 0.3, 1.1, 2.9}) {
            const Complex z = (1.0 - std::polar(radius, angle)) / h - mu[l];
            EXPECT_LE(pole_sum_error(sum, both(z), z), 4 * std::max(sum.error, 1e-14)) << c << ' ' << z;
          }
    }
}

TEST(TransferFit, GivesNoFiniteErrorWhereAValueIsNotFinite) {
  const TransferFunctions bad = [](Complex) -> ComplexVector { return ComplexVector::Constant(1, NAN); };
  const PoleSum sum = fit_poles(bad, 1, {false, 0.1, 1, 1, 10}, 1, 100, false);
  EXPECT_FALSE(sum.error <= accepted_fit_error);
}

// A pole in the right half-plane is no sum of decaying exponentials.
TEST(TransferFit, MissesAnUnstablePole) {
  const TransferFunctions unstable = [](Complex z) -> ComplexVector {
    return ComplexVector::Constant(1, 1.0 / (z - Complex(30, 0)));
  };
  EXPECT_GT(fit_poles(unstable, 1, {false, 0.01, 1, 1, 10}, 1, 1e3, false).error, 1e-3);
}

// Weights of implicit Euler from all eigenvalues of a line, which the fit does not use.
TEST(TransferFit, CompressesImplicitEuler) {
  const Scene scene = make_scene("contact", {{"Q", 63}});
  const auto backend = make_cpu_backend(1);
  const DiscreteProblem p = discretise(scene, *backend, 128);
  const auto op = make_time_operator(p);
  const MarchData few = op->march_weights(Rule::implicit_euler, RecurrenceChoice::compressed),
                  all = op->march_weights(Rule::implicit_euler, RecurrenceChoice::modal);
  ASSERT_TRUE(few.compressed);
  const LagTable found = lag_table(std::get<Recurrence>(*few.weights), 128),
                 expected = lag_table(std::get<Recurrence>(*all.weights), 128);
  EXPECT_LE(few.error, 1e-11);
  // The error at |zeta| = 1 bounds that of every weight, relative to the largest value of the transfer function there,
  // Σ_d W_d of the slowest mode.
  const double largest = expected.W.colwise().sum().maxCoeff();
  EXPECT_LE(distance(found.W, expected.W), 4 * std::max(few.error, 1e-14) * largest);
}

TEST(TransferFit, ImplicitEulerIsTheSameWithFewPoles) {
  const Scene scene = make_scene("contact", {{"Q", 63}, {"eps", 0.01}});
  Options few = options_for(Method::euler, 128), all = few;
  few.tuning.recurrence = RecurrenceChoice::compressed;
  all.tuning.recurrence = RecurrenceChoice::modal;
  const Result found = run(scene, few), expected = run(scene, all);
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  ASSERT_EQ(expected.status, Status::solved) << expected.reason;
  // Weights to 1e-13 of K, and V = K^{-1} of size 100 on this grid.
  EXPECT_LE(distance(found.y, expected.y), 1e-10);
}

}  // namespace
}  // namespace bromwich
