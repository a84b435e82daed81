// Grid lines with ends that reflect: their modes and their Green's function against dense matrices.

#include "core/dynamics/second_difference.hpp"

#include "core/dynamics/line_transfer.hpp"

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <cmath>
#include <vector>

namespace bromwich {
namespace {

Matrix written_out(const SecondDifference& d) {
  const double scale = d.diffusivity / (d.spacing * d.spacing);
  Matrix L = Matrix::Zero(d.points, d.points);
  for (Index i = 0; i < d.points; ++i) {
    L(i, i) -= 2 * scale + d.decay;
    if (i > 0) L(i, i - 1) += scale;
    if (i + 1 < d.points) L(i, i + 1) += scale;
  }
  L(0, 0) += scale * d.first;
  L(d.points - 1, d.points - 1) += scale * d.last;
  return L;
}

std::vector<SecondDifference> lines() {
  std::vector<SecondDifference> all;
  for (const Index points : {1, 2, 7, 32, 33})
    for (const double first : {0.0, 1.0, 0.37, -0.8, 1 - 1e-9})
      for (const double last : {0.0, 1.0, 0.92}) all.push_back({points, 0.1, 0.3, first, last, 0.7});
  return all;
}

TEST(SecondDifference, ModesOfAllEndsDiagonaliseIt) {
  for (const SecondDifference& d : lines()) {
    const Matrix L = written_out(d), Q = d.modes();
    const Vector lambda = d.eigenvalues();
    const double size =
        4 * d.diffusivity / (d.spacing * d.spacing) + d.decay;  // of its terms, which cancel at the ends
    // Angles i theta carry a rounding of points pi eps, and so does each entry; a product sums over the points.
    const double rounding = 16 * double(d.points * d.points) * epsilon;
    EXPECT_LE((Q.transpose() * Q - Matrix::Identity(d.points, d.points)).cwiseAbs().maxCoeff<Eigen::PropagateNaN>(),
              rounding)
        << d.points << " " << d.first << " " << d.last;
    EXPECT_LE((L * Q - Q * lambda.asDiagonal()).cwiseAbs().maxCoeff<Eigen::PropagateNaN>(), rounding * size)
        << d.points << " " << d.first << " " << d.last;
    EXPECT_LE((Eigen::SelfAdjointEigenSolver<Matrix>(L).eigenvalues().reverse() - lambda)
                  .cwiseAbs()
                  .maxCoeff<Eigen::PropagateNaN>(),
              rounding * size * double(d.points));
    Vector v = Vector::Zero(d.points);
    v[0] = 2, v[d.points - 1] -= 0.5;
    EXPECT_LE((d.in_modes(v) - Q.transpose() * v).cwiseAbs().maxCoeff<Eigen::PropagateNaN>(), rounding);
  }
}

TEST(SecondDifference, GreensFunctionsOfAllEndsAreTheInverse) {
  for (const SecondDifference& d : lines()) {
    const Matrix L = written_out(d);
    Vector n = Vector::Zero(d.points), b = n;
    n[0] = -2, b[0] = 3;
    if (d.points > 2) n[2] = 0.5, b[1] = -1, b[d.points - 1] = 0.25;
    const LineTransfer transfer(d, n, b);
    for (const Complex z : {Complex(0, 0), Complex(1e-6, 2e-3), Complex(-3, 40), Complex(0, 1e3), Complex(1e5, -1e6)}) {
      ComplexMatrix shifted = -L.cast<Complex>();
      shifted.diagonal().array() += z;
      const Eigen::PartialPivLU<ComplexMatrix> lu(shifted);
      const ComplexVector row = lu.transpose().solve(n.cast<Complex>());
      const ComplexVector found = green_row(d, n, z);
      // Rounding of the dense solve grows with its condition; with two Neumann ends it is 1/decay at z = 0.
      const double condition =
          shifted.cwiseAbs().rowwise().sum().maxCoeff() * lu.inverse().cwiseAbs().rowwise().sum().maxCoeff();
      const double allowed =
          32 * epsilon * (double(d.points) + condition) * row.cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
      EXPECT_LE((found - row).cwiseAbs().maxCoeff<Eigen::PropagateNaN>(), allowed)
          << d.points << " " << d.first << " " << d.last << " " << z;
      EXPECT_LE(std::abs(transfer(z) - (row.transpose() * b.cast<Complex>())(0)), allowed * b.cwiseAbs().sum());
    }
  }
}

}  // namespace
}  // namespace bromwich
