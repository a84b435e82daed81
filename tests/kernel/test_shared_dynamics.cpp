// What grids of one scene share: the same numbers as grids on their own, made fewer times.

#include "core/kernel/shared_dynamics.hpp"

#include "catalogue/catalogue.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/kernel.hpp"
#include "core/kernel/sparse_kernel.hpp"
#include "core/numerics/matrix_phi.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

namespace bromwich::shared_test {
namespace {

using reference::Random;

double apart(const Matrix& a, const Matrix& b) {
  return (a - b).cwiseAbs().maxCoeff() / std::max(1.0, b.cwiseAbs().maxCoeff());
}

// Halved steps need no new series while h |A| > 1, doubled ones a doubling.
TEST(PhiFamily, HalvedStepsAreMadeOnTheWay) {
  Random random(2);
  const Index m = 20;
  const Matrix A = random.matrix(m, m) - 12 * Matrix::Identity(m, m);
  PhiFamily family(A);
  double h = 1;
  for (int k = 0; k < 5; ++k, h /= 2) {
    const MatrixPhi expected = matrix_phi(h * A);
    const auto found = family.phi(h);
    EXPECT_LE(apart(found->exponential, expected.exponential), 1e-13) << h;
    EXPECT_LE(apart(found->phi1, expected.phi1), 1e-13) << h;
    EXPECT_LE(apart(found->phi2, expected.phi2), 1e-13) << h;
    EXPECT_EQ(family.counts().made, 1) << h;
  }
  EXPECT_GT(family.counts().kept, 3);
  const Index doubled = family.counts().doubled;
  EXPECT_LE(apart(family.phi(2)->phi1, matrix_phi(2 * A).phi1), 1e-13);
  EXPECT_EQ(family.counts().made, 1);
  EXPECT_EQ(family.counts().doubled, doubled + 1);
}

// The order of the calls makes no difference, to the last bit.
TEST(PhiFamily, DoesNotDependOnTheOrder) {
  Random random(4);
  const Matrix A = 3 * random.matrix(18, 18);
  PhiFamily up(A), down(A);
  for (const double h : {0.01, 0.02, 0.04, 0.08, 0.16}) up.phi(h), up.phis(h);
  for (const double h : {0.16, 0.08, 0.04, 0.02, 0.01}) down.phi(h), down.phis(h);
  for (const double h : {0.01, 0.04, 0.16}) {
    EXPECT_EQ(up.phi(h)->phi2, down.phi(h)->phi2) << h;
    EXPECT_EQ((*up.phis(h))[5], (*down.phis(h))[5]) << h;
    EXPECT_EQ(up.phi(h)->phi2, matrix_phi(h * A).phi2) << h;
  }
}

TEST(PhiFamily, SixFunctionsOfEveryKindOfMatrix) {
  Random random(6);
  const Matrix any = random.matrix(5, 5), large = random.matrix(19, 19);
  const Matrix stiff =
      Vector::LinSpaced(6, -1e6, -1).asDiagonal() * Matrix(Matrix::Ones(6, 6).triangularView<Eigen::Upper>());
  for (const Matrix& A : {any, large, Matrix(any + any.transpose()), stiff, Matrix(0, 0)}) {
    PhiFamily family(A);
    for (const double h : {0.3, 0.15, 0.6}) {
      const std::vector<Matrix> expected = matrix_phis(h * A, 5);
      const auto found = family.phis(h);
      ASSERT_EQ(found->size(), expected.size());
      for (std::size_t k = 0; k < expected.size() && A.rows() > 0; ++k)
        EXPECT_LE(apart((*found)[k], expected[k]), 1e-12) << A.rows() << " phi_" << k << " at " << h;
    }
  }
  PhiFamily symmetric(any + any.transpose());
  for (const double h : {1., 0.5, 0.7}) symmetric.phi(h), symmetric.phis(h);
  EXPECT_EQ(symmetric.counts().made, 1) << "one diagonalisation";
}

TEST(SharedDynamics, WindowsOfHalvedStepsShareTheirNodes) {
  const ContourParameters parameters = *contour_parameters(0);
  for (const double first : {0.01, 1.0, 0.37}) {
    SharedDynamics shared(DenseDynamics{}, true);
    std::set<double> seen;
    Index J = 40, fresh = 0, all = 0;
    for (int k = 0; k < 5; ++k, J *= 2)
      for (const double part : {1.0, 0.75}) {
        const double h = first * 40 / double(J) / part;
        const Index steps = Index(double(J) * part);
        Index next = 0;
        for (const LagWindow& window : shared.windows(parameters, h, steps, 0)) {
          EXPECT_EQ(window.first, next);
          EXPECT_GE(h * double(std::max<Index>(window.first - 1, 1)), window.contour.t0 * (1 - 1e-12)) << J;
          EXPECT_LE(h * double(window.last + 1), window.contour.t1 * (1 + 1e-12)) << J;
          next = window.last + 1;
          ++all;
          fresh += seen.insert(window.contour.nodes[0].real()).second;
        }
        EXPECT_EQ(next, steps + 1);
      }
    EXPECT_LE(fresh, all / 2) << "of all windows";
  }
  // Steps with nothing in common.
  SharedDynamics shared(DenseDynamics{}, true);
  shared.windows(parameters, 1.0 / 64, 64, 0);
  EXPECT_EQ(shared.windows(parameters, 1.0 / 97, 97, 0).back().last, 97);
}

TEST(SharedDynamics, OneFitForSixHalvings) {
  const Scene scene = make_scene("signorini", {{"Q", 80}});
  const KroneckerDynamics& d = *scene.dynamics->modes();
  SharedDynamics shared(scene.dynamics, true);
  const double h = scene.T / 50;
  for (int k = 0; k <= 6; ++k) {
    const double step = h / std::exp2(k);
    const auto fit = shared.fit(step, scene.T);
    EXPECT_LE(fit->error_from(step), accepted_compression_error);
    // A fit of this step's own agrees at times it has not seen.
    const ExponentialSum own = compress_line_kernel(d, step, scene.T);
    const auto at = [](const ExponentialSum& s, double t) {
      return s.coefficients.col(0).dot((t * s.rates.array()).exp().matrix());
    };
    for (const double t : {1.3 * step, 17.7 * step, 0.77 * scene.T})
      EXPECT_NEAR(at(fit->sum, t), at(own, t), 1e-11 * std::abs(at(own, step))) << k << " at " << t;
  }
  EXPECT_EQ(shared.counts().fits, 1);
  SharedDynamics alone(scene.dynamics);
  alone.fit(h, scene.T);
  alone.fit(h / 2, scene.T);
  alone.fit(h / 2, scene.T);
  EXPECT_EQ(alone.counts().fits, 2) << "no grids are expected: a fit begins with the first step";
}

TEST(SharedDynamics, ShiftedSolvesOfEarlierGridsAreKept) {
  Scene scene = make_scene("signorini", {{"Q", 12}});
  scene.dynamics = to_sparse(get<KroneckerDynamics>(scene.dynamics));
  const auto backend = make_cpu_backend(1);
  GridFamily family(true);
  Index shared = 0, alone = 0;
  for (const Index J : {50, 100, 200, 400}) {
    GridFamily own;
    const DiscreteProblem with = discretise(scene, *backend, J, false, &family),
                          without = discretise(scene, *backend, J, false, &own);
    const auto found = sparse_kernel(with, {0}), expected = sparse_kernel(without, {0});
    ASSERT_TRUE(found && expected);
    const double scale = expected->weights.W.cwiseAbs().maxCoeff();
    EXPECT_LE((found->weights.W - expected->weights.W).cwiseAbs().maxCoeff(), 1e-11 * scale) << J;
    EXPECT_LE((found->weights.S - expected->weights.S).cwiseAbs().maxCoeff(), 1e-11 * scale) << J;
    EXPECT_LE((found->seen_free - expected->seen_free).cwiseAbs().maxCoeff(), 1e-10) << J;
    EXPECT_LE(found->error, accepted_contour_error);
    alone += own.counts().shifted_solves;
  }
  shared = family.counts().shifted_solves;
  EXPECT_LE(shared, 7 * alone / 10);
  EXPECT_EQ(family.counts().spectra, 1);
  EXPECT_LE(family.counts().classifications, 1);
}

// Another x0 is another column of the solves.
TEST(SharedDynamics, SolvesWithOtherColumnsAreNotTaken) {
  Scene scene = make_scene("signorini", {{"Q", 8}});
  scene.dynamics = to_sparse(get<KroneckerDynamics>(scene.dynamics));
  const auto backend = make_cpu_backend(1);
  GridFamily family(true);
  for (const double factor : {1.0, 2.0, 2.0}) {
    Scene other = scene;
    other.x0 = factor * scene.x0 + Vector::Constant(scene.states(), factor - 1);
    const DiscreteProblem p = discretise(other, *backend, 30, false, &family);
    const auto found = sparse_kernel(p, {}), expected = sparse_kernel(discretise(other, *backend, 30), {});
    ASSERT_TRUE(found && expected);
    EXPECT_LE((found->free - expected->free).cwiseAbs().maxCoeff(), 1e-11 * expected->free.cwiseAbs().maxCoeff());
  }
}

TEST(GridFamily, KnowsItsDynamicsAndTheClassOfM) {
  GridFamily family;
  const Scene scene = make_scene("dlcp-small");
  const Scene copy = scene;
  EXPECT_EQ(family.of(scene.dynamics).get(), family.of(copy.dynamics).get()) << "copies share the matrices";
  Scene changed = scene;
  if (auto* d = get_if<DenseDynamics>(&changed.dynamics)) d->A *= 2;
  EXPECT_NE(family.of(scene.dynamics).get(), family.of(changed.dynamics).get());
  Scene automatic = scene;
  automatic.lcp_class = LcpClass::automatic;
  automatic.M = Matrix(2 * Matrix::Identity(scene.constraints(), scene.constraints()));
  const LcpClass found = family.lcp_class(automatic);
  EXPECT_EQ(found, LcpClass::P);
  EXPECT_EQ(family.lcp_class(automatic), found);
  EXPECT_EQ(family.counts().classifications, 1);
  automatic.M = Matrix(-to_dense(automatic.M));
  EXPECT_NE(family.lcp_class(automatic), found);
  EXPECT_EQ(family.counts().classifications, 2);
}

}  // namespace
}  // namespace bromwich::shared_test
