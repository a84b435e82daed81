// Derivatives of batches by parameters: rattling gears by mu and e, against differences of located events that share no
// code with the solver, and gears without a derivative.

#include "batch/batch_parameters.hpp"
#include "core/base/error.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/mechanics/contact_flow.hpp"
#include "tests/mechanics/structures.hpp"

#include <gtest/gtest.h>

namespace bromwich::batch_parameters_test {
namespace {

constexpr double T = 3;

struct Gears {
  std::vector<double> mu, e;
  Index count() const { return Index(mu.size()); }
  Batch batch() const {
    Batch b;
    for (Index k = 0; k < count(); ++k) b.own.push_back(scene(mu[std::size_t(k)], e[std::size_t(k)]));
    b.common = b.own.front();
    b.scenes = count();
    b.times = {0, 1, 2, T};
    return b;
  }
  static Scene scene(double mu, double e) { return rattling_gear(mu, e, T).scene; }
  std::vector<VariedParameter> parameters(Index k) const {
    const double of_mu = mu[std::size_t(k)], of_e = e[std::size_t(k)];
    return {{"mu", of_mu,
             [of_e](double value) {
               return ParameterScene{scene(value, of_e), nullptr};
             }},
            {"e", of_e, [of_mu](double value) {
               return ParameterScene{scene(of_mu, value), nullptr};
             }}};
  }
};

BatchResult solved(const Batch& batch) {
  Options options;
  options.tolerance = 1e-6;
  options.states = StateSelection::all;
  return solve_batch(batch, *make_cpu_backend(1), options);
}

Vector end(double mu, double e) {
  const oracle::ContactFlow flow = oracle::contact_flow(rattling_gear(mu, e, T), 1, 1e-3);
  EXPECT_TRUE(flow.decided) << flow.reason;
  return (Vector(4) << flow.q[0], flow.v[0]).finished();
}

// The oracle is right to about 1e-9, which the step of the differences divides.
TEST(BatchParameters, OfRattlingGears) {
  constexpr double step = 1e-4, within = 1e-4;
  const Gears gears{{0.1, 0.2, 0.3, 0.1, 0.25}, {0.8, 0.7, 0.6, 0.5, 0.9}};
  const Batch batch = gears.batch();
  const BatchResult r = solved(batch);
  const auto backend = make_cpu_backend(2);
  const BatchJacobian found = jacobian_of(
      batch, r, [&](Index k) { return gears.parameters(k); }, *backend, std::nullopt, *backend);
  for (Index k = 0; k < gears.count(); ++k) {
    const std::size_t i = std::size_t(k);
    SCOPED_TRACE(testing::Message() << "mu = " << gears.mu[i] << ", e = " << gears.e[i]);
    ASSERT_EQ(r.status[i], Status::solved) << r.reason[i];
    ASSERT_EQ(found.reason[i], "");
    EXPECT_GT(found.margin[i].transversality, 0);
    const Vector by_mu = (end(gears.mu[i] + step, gears.e[i]) - end(gears.mu[i] - step, gears.e[i])) / (2 * step),
                 by_e = (end(gears.mu[i], gears.e[i] + step) - end(gears.mu[i], gears.e[i] - step)) / (2 * step);
    const double size = 1 + std::max(by_mu.cwiseAbs().maxCoeff(), by_e.cwiseAbs().maxCoeff());
    EXPECT_LE((found.by[0][i].x.bottomRows(1).transpose() - by_mu).cwiseAbs().maxCoeff(), within * size);
    EXPECT_LE((found.by[1][i].x.bottomRows(1).transpose() - by_e).cwiseAbs().maxCoeff(), within * size);
  }
}

// Without rebound there is no scene on one side of e; the others keep their derivatives.
TEST(BatchParameters, OneWithoutDerivative) {
  const Gears gears{{0.1, 0.2, 0.1}, {0.8, 0, 0.6}};
  const Batch batch = gears.batch();
  const BatchResult r = solved(batch);
  const BatchJacobian found = jacobian_of(
      batch, r, [&](Index k) { return gears.parameters(k); }, *make_cpu_backend(1));
  EXPECT_EQ(found.reason[0], "");
  EXPECT_NE(found.reason[1], "");
  EXPECT_EQ(found.by[0][1].x.size(), 0);
  EXPECT_EQ(found.margin[1].margin, 0);
  EXPECT_EQ(found.reason[2], "");
  EXPECT_EQ(found.by[1][2].x.rows(), 4);
}

TEST(BatchParameters, OfAnotherBatch) {
  const Gears gears{{0.1}, {0.8}}, more{{0.1, 0.1}, {0.8, 0.7}};
  const BatchResult r = solved(gears.batch());
  EXPECT_THROW(jacobian_of(
                   more.batch(), r, [&](Index k) { return more.parameters(k); }, *make_cpu_backend(1)),
               Error);
}

}  // namespace
}  // namespace bromwich::batch_parameters_test
