// The oracle itself, against formulas and quadrature.

#include "core/base/types.hpp"
#include "tests/support/oracle.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich::oracle {
namespace {

TEST(Oracle, PhiFunctionsOfScalars) {
  for (const double z : {-30.0, -2.0, -1e-3, 0.5}) {
    const Phi phi = phi_functions(Matrix::Constant(1, 1, z));
    const double phi1 = std::expm1(z) / z;
    // The formula for phi2 cancels: its rounding error is about epsilon/|z|.
    EXPECT_NEAR(phi.exponential(0, 0), std::exp(z), 1e-14);
    EXPECT_NEAR(phi.phi1(0, 0), phi1, 1e-14);
    EXPECT_NEAR(phi.phi2(0, 0), (phi1 - 1) / z, 1e-14 + 4 * epsilon / std::abs(z));
  }
}

TEST(Oracle, WeightsAreTheIntegralsOfTheHats) {
  for (std::uint32_t seed = 0; seed < 9; ++seed) {
    const Scene scene = random_scene(seed, 1 + seed % 6, 1 + seed % 4, SpectrumKind(seed % 3), MatrixKind::dominant);
    const DenseScene s = write_out(scene);
    const double h = 1. / 16;
    const Weights by_phi = weights(s, h, 16), by_quadrature = quadrature_weights(s, h, 16);
    for (std::size_t d = 0; d <= 16; ++d) {
      // Entries are at most h ||N|| ||B|| cond(V) < 4; 16 points are exact beyond rounding for ||hA|| <= 2.
      EXPECT_LE((by_phi.W[d] - by_quadrature.W[d]).cwiseAbs().maxCoeff(), 1e-14) << "lag " << d;
      EXPECT_LE((by_phi.S[d] - by_quadrature.S[d]).cwiseAbs().maxCoeff(), 1e-14) << "lag " << d;
    }
  }
}

TEST(Oracle, MarchingEqualsTheConvolution) {
  const Index J = 20;
  const Scene scene = random_scene(5, 4, 3, SpectrumKind::sector, MatrixKind::dominant);
  DenseScene s = write_out(scene);
  s.f = [](double, Eigen::Ref<Vector> f) { f.setZero(); };
  const Trajectory run = march(s, J);
  const double h = s.T / double(J);
  const Weights w = weights(s, h, J);
  for (Index j = 0; j <= J; ++j) {
    Vector v = s.N * exponential(double(j) * h * s.A) * s.x0;
    if (j > 0) v += w.S[std::size_t(j)] * run.y.row(0).transpose();
    for (Index d = 0; d < j; ++d) v += w.W[std::size_t(d)] * run.y.row(j - d).transpose();
    // 20 products of decaying exponentials, each with a relative error of a few epsilon.
    EXPECT_LE((v - s.N * run.x.row(j).transpose()).cwiseAbs().maxCoeff(), 1e-13) << "row " << j;
  }
}

TEST(Oracle, EnumeratesSolutions) {
  const Matrix P{{1, 0, 2}, {2, 1, 0}, {0, 2, 1}};  // semismooth Newton cycles here
  const auto y = solve_lcp(P, Vector::Constant(3, -1), LcpClass::P);
  ASSERT_TRUE(y);
  EXPECT_LE((*y - Vector::Constant(3, 1. / 3)).cwiseAbs().maxCoeff(), 1e-15);

  const Matrix Z{{1, -2}, {-2, 1}};
  const auto least = solve_lcp(Z, Vector{{-1, 3}}, LcpClass::Z);
  ASSERT_TRUE(least);
  EXPECT_LE((*least - Vector{{1, 0}}).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_FALSE(solve_lcp(Z, Vector{{-1, 1.9}}, LcpClass::Z));

  EXPECT_DOUBLE_EQ(lipschitz(Matrix{{2, 0}, {0, 0.5}}), 2);
  EXPECT_TRUE(std::isinf(lipschitz(Matrix{{0, 1}, {1, 1}})));
}

}  // namespace
}  // namespace bromwich::oracle
