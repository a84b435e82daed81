// Solves with kept factors at many shifts against dense eliminations, and where pivots are needed.

#include "core/dynamics/sparse_shifts.hpp"

#include "core/seam/backend.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>
#include <Eigen/LU>

#include <cmath>
#include <string>
#include <vector>

namespace bromwich::sparse_shifts_test {
namespace {

using reference::Random;

// -Laplacian on a rectangle of q x (q + 3) points, with advection where `wind` is not 0.
SparseMatrix diffusion(Index q, double wind) {
  const Index width = q + 3, m = q * width;
  std::vector<Eigen::Triplet<double>> entries;
  const auto couple = [&](Index k, Index l) {
    entries.emplace_back(k, l, 1 + wind);
    entries.emplace_back(l, k, 1 - wind);
  };
  for (Index k = 0; k < m; ++k) {
    entries.emplace_back(k, k, -4 - 0.01 * double(k % 7));
    if (k % width + 1 < width) couple(k, k + 1);
    if (k + width < m) couple(k, k + width);
  }
  SparseMatrix A(m, m);
  A.setFromTriplets(entries.begin(), entries.end());
  return A;
}

SparseMatrix mass(Index m, bool symmetric) {
  std::vector<Eigen::Triplet<double>> entries;
  for (Index k = 0; k < m; ++k) {
    entries.emplace_back(k, k, 1 + 0.1 * double(k % 3));
    if (k + 1 < m) entries.emplace_back(k, k + 1, 0.1);
    if (symmetric && k + 1 < m) entries.emplace_back(k + 1, k, 0.1);
  }
  SparseMatrix E(m, m);
  E.setFromTriplets(entries.begin(), entries.end());
  return E;
}

ComplexVector shifts(Index count) {
  ComplexVector z(count);
  for (Index p = 0; p < count; ++p) z[p] = {0.5 + 0.3 * double(p), 2.0 * double(p % 5)};
  return z;
}

TEST(SparseShifts, SolveAsDenseEliminations) {
  const auto threads = make_cpu_backend(2);
  const Index q = 11, m = q * (q + 3), P = 11;  // a full group of lanes and a part of one; fronts of several panels
  const ComplexVector z = shifts(P);
  Random random(4);
  const ComplexMatrix right = random.matrix(m, P).cast<Complex>() + Complex(0, 1) * random.matrix(m, P).cast<Complex>();
  for (const double wind : {0.0, 0.3})
    for (const int with_mass : {0, 1, 2}) {
      const std::string where = "wind " + std::to_string(wind) + " mass " + std::to_string(with_mass);
      SparseDynamics d{diffusion(q, wind), SparseMatrix(m, 1), SparseMatrix(1, m)};
      if (with_mass > 0) d.E = mass(m, with_mass == 1);
      const Matrix E = with_mass > 0 ? Matrix(d.E) : Matrix(Matrix::Identity(m, m));
      const SparseShifts all(d);
      const auto factors = all.factorize(z, *threads);
      ASSERT_TRUE(factors) << where;
      EXPECT_GT(factors->bytes(), 0u);
      for (const bool transposed : {false, true}) {
        const ComplexMatrix found = factors->solve(right, transposed, *threads);
        for (Index p = 0; p < P; ++p) {
          const ComplexMatrix shifted = z[p] * E.cast<Complex>() - Matrix(d.A).cast<Complex>();
          const ComplexMatrix given = transposed ? ComplexMatrix(shifted.transpose()) : shifted;
          // The numerical range of A is left of 0, so that the distance of z bounds the condition by about 30.
          EXPECT_LE((given * found.col(p) - right.col(p)).norm(), 1e-12 * right.col(p).norm()) << where << " " << p;
        }
      }
    }
}

TEST(SparseShifts, OfSupernodesWiderThanAPanel) {
  const auto threads = make_cpu_backend(1);
  const Index m = 70;  // dense: one front
  Random random(6);
  for (const bool symmetric : {true, false}) {
    Matrix A = random.matrix(m, m);
    A = symmetric ? Matrix(A + A.transpose()) : A;
    A.diagonal().array() -= 60;
    const SparseDynamics d{A.sparseView(), SparseMatrix(m, 1), SparseMatrix(1, m)};
    const SparseShifts all(d);
    const ComplexVector z = shifts(3);
    const auto factors = all.factorize(z, *threads);
    ASSERT_TRUE(factors);
    const ComplexMatrix right = random.matrix(m, 3).cast<Complex>();
    for (const bool transposed : {false, true}) {
      const ComplexMatrix found = factors->solve(right, transposed, *threads);
      const Matrix given = transposed ? Matrix(A.transpose()) : A;
      for (Index p = 0; p < 3; ++p)
        EXPECT_LE((z[p] * found.col(p) - given.cast<Complex>() * found.col(p) - right.col(p)).norm(),
                  1e-12 * right.col(p).norm());
    }
  }
}

// zE - A has a zero on its diagonal: it is regular, but not without exchanges of rows.
TEST(SparseShifts, SayWherePivotsAreNeeded) {
  const auto threads = make_cpu_backend(1);
  Matrix A{{1, -1}, {1, 1}};
  const SparseDynamics d{A.sparseView(), SparseMatrix(2, 1), SparseMatrix(1, 2)};
  const SparseShifts all(d);
  ComplexVector z(1);
  z[0] = 1;
  EXPECT_FALSE(all.factorize(z, *threads));
  z[0] = 2;
  EXPECT_TRUE(all.factorize(z, *threads));
}

}  // namespace
}  // namespace bromwich::sparse_shifts_test
