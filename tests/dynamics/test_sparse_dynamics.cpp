// Large sparse A at sizes that allow dense references: shifted solves against dense ones, the order of elimination, and
// estimates of the spectrum against known eigenvalues.

#include "core/base/error.hpp"
#include "core/dynamics/sparse.hpp"
#include "core/dynamics/spectrum.hpp"
#include "core/numerics/elimination.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/sparse_grids.hpp"

#include <Eigen/Dense>
#include <Eigen/SparseCholesky>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

using reference::Random;

/// Entries of a random pattern, `filled` per row on average.
SparseMatrix random_sparse(Random& random, Index rows, Index cols, double filled) {
  Triplets entries;
  for (Index i = 0; i < rows; ++i)
    for (Index j = 0; j < cols; ++j)
      if (random.uniform(0, 1) * double(cols) < filled) entries.emplace_back(i, j, random.uniform());
  return assemble(rows, cols, entries);
}

ComplexMatrix dense_resolvent(const SparseDynamics& d, const ComplexVector& nodes) {
  const Index m = d.A.rows(), n = d.N.rows(), k = d.B.cols();
  ComplexMatrix R(nodes.size(), n * k);
  for (Index p = 0; p < nodes.size(); ++p) {
    const ComplexMatrix shifted = nodes[p] * ComplexMatrix::Identity(m, m) - Matrix(d.A).cast<Complex>();
    const ComplexMatrix X = Matrix(d.N).cast<Complex>() * shifted.partialPivLu().solve(Matrix(d.B).cast<Complex>());
    for (Index i = 0; i < n; ++i)
      for (Index j = 0; j < k; ++j) R(p, i * k + j) = X(i, j);
  }
  return R;
}

class SparseResolvent : public BackendTest {};
INSTANTIATE_TEST_SUITE_P(Contract, SparseResolvent, testing::ValuesIn(backend_cases()), backend_case_name);

TEST_P(SparseResolvent, AgreesWithDenseSolves) {
  Random random(3);
  // One state; a symmetric grid; a wind; an unsymmetric pattern with empty rows; several components; and a full matrix,
  // which is a single front with several panels.
  const std::vector<SparseMatrix> matrices{assemble(1, 1, {{0, 0, -2.0}}),
                                           grid(9, 7),
                                           grid(8, 8, 1, 30),
                                           random_sparse(random, 50, 50, 2),
                                           assemble(40, 40, {{0, 1, 1.0}, {7, 7, -3.0}, {30, 2, 2.0}}),
                                           random.matrix(75, 75).sparseView()};
  for (const SparseMatrix& A : matrices)
    for (const auto& [outputs, inputs] : {std::pair<Index, Index>{1, 1}, {3, 2}, {2, 11}}) {
      const Index m = A.rows();
      // Columns that are sparse, and one that is full.
      SparseMatrix B = random_sparse(random, m, inputs, 1.0), N = random_sparse(random, outputs, m, 3.0);
      B.coeffRef(0, 0) = 1;
      N.coeffRef(outputs - 1, m - 1) = 1;
      if (inputs == 11) B = Matrix(random.matrix(m, inputs)).sparseView();
      const SparseDynamics d{A, B, N};
      // No node is close to an eigenvalue: nodes have imaginary parts above 12, random spectra have radii below 12.
      ComplexVector all(17);
      for (Index p = 0; p < all.size(); ++p) all[p] = Complex(5 - 3 * double(p), 13 + 2 * double(p));
      const ComplexMatrix all_exact = dense_resolvent(d, all);
      for (const Index count : {1, 8, 17}) {
        const ComplexVector nodes = all.head(count);
        const ComplexMatrix found = backend->resolvent(Dynamics(d), nodes), exact = all_exact.topRows(count);
        ASSERT_EQ(found.rows(), exact.rows());
        ASSERT_EQ(found.cols(), exact.cols());
        // Condition numbers below 1e3, sums of about 100 operations: 1e3 * 100 eps.
        EXPECT_LE((found - exact).cwiseAbs().maxCoeff(), 1e-11 * exact.cwiseAbs().maxCoeff()) << m << ' ' << count;
      }
    }
}

// Symmetric A and N = D B^T for the first columns of B: one triangle of the border is reduced. With a state that two
// contacts share, a contact at several states, further columns of B, and an N that is not of this form by one entry.
TEST_P(SparseResolvent, ReducesASymmetricBorderOnce) {
  Random random(4);
  const Index m = 9 * 7;
  for (const Index more : {0, 2})
    for (const bool spoiled : {false, true}) {
      SparseMatrix A = grid(9, 7);
      for (Index k = 0; k < m; ++k)  // symmetric up to rounding
        for (SparseMatrix::InnerIterator a(A, k); a; ++a)
          if (a.row() < k) a.valueRef() *= 1 + (more > 0 ? 2 * epsilon : 0);
      const SparseMatrix contacts = random_sparse(random, m, 5, 2.0);
      Matrix B(m, 5 + more), N = 3 * Matrix(contacts).transpose();
      B.leftCols(5) = Matrix(contacts);
      B.rightCols(more) = random.matrix(m, more);
      for (Index i = 0; i < 5; ++i) {
        B(7 * i, i) = B(7 * i + 7, i) = 1;
        N.row(i) = (i % 2 == 0 ? -0.3 : 2 + double(i)) * B.col(i).transpose();
      }
      if (spoiled) N(2, 14) *= 1.5;
      const SparseDynamics d{A, B.sparseView(), N.sparseView()};
      const ComplexVector nodes{{Complex(5, 13), Complex(-10, 40), Complex(0.5, 3)}};
      const ComplexMatrix found = backend->resolvent(Dynamics(d), nodes), exact = dense_resolvent(d, nodes);
      EXPECT_LE((found - exact).cwiseAbs().maxCoeff(), 1e-11 * exact.cwiseAbs().maxCoeff()) << more << spoiled;
    }
}

TEST_P(SparseResolvent, PivotsWhereTheOrderNeedsIt) {
  // Without pivoting the first pivot is z = 0, which is not an eigenvalue (they are 1 and -1).
  const SparseDynamics d{assemble(2, 2, {{0, 1, 1.0}, {1, 0, 1.0}}), assemble(2, 1, {{0, 0, 1.0}}),
                         assemble(1, 2, {{0, 1, 1.0}})};
  const ComplexMatrix R = backend->resolvent(Dynamics(d), ComplexVector{{Complex(0, 0), Complex(0, 2)}});
  EXPECT_LE(std::abs(R(0, 0) + 1.0), 1e-15);
  // (2i I - A)^{-1} = (2i I + A)/(-4 - 1).
  EXPECT_LE(std::abs(R(1, 0) + 0.2), 1e-15);
}

TEST_P(SparseResolvent, RefusesAnEigenvalue) {
  const SparseMatrix diagonal = assemble(3, 3, {{0, 0, -1.0}, {1, 1, -2.0}, {2, 2, -3.0}});
  const SparseMatrix pair = assemble(2, 2, {{0, 0, -2.0}, {0, 1, 1.0}, {1, 0, 1.0}, {1, 1, -2.0}});
  for (const auto& [A, z] : {std::pair{diagonal, -2.0}, {pair, -1.0}}) {
    const SparseMatrix B = Matrix::Ones(A.rows(), 1).sparseView(), N = Matrix::Ones(1, A.rows()).sparseView();
    const Dynamics dynamics = SparseDynamics{A, B, N};
    const auto at = [&](Complex node) { backend->resolvent(dynamics, ComplexVector{{Complex(1, 1), node}}); };
    EXPECT_THROW(at(z), Error);
    EXPECT_NO_THROW(at(Complex(z, 1e-3)));
  }
}

TEST(Elimination, CountsAFullMatrix) {
  // One front: 10 pivots, 1 output, 2 inputs and a dense one.
  const SparseMatrix A = Matrix::Ones(10, 10).sparseView(), B = Matrix::Ones(10, 2).sparseView(),
                     N = Matrix::Ones(1, 10).sparseView();
  const Elimination e = analyse(A, B, N, 1);
  ASSERT_EQ(e.fronts.size(), 1u);
  EXPECT_EQ(e.largest_front, 11 * 13);
  EXPECT_EQ(e.largest_stack, 0);
  double products = 0;
  for (int p = 1; p <= 10; ++p) products += (11 - p) * (13 - p);
  EXPECT_EQ(e.products, products);
}

TEST(Elimination, StaysSmallOnAGrid) {
  // Nested dissection of a G x G grid leaves O(G^2) on the stack. A band order would cost G^4 = 3e5 times 24, a good
  // order 31 G^3 (George, 1973), with room for a factor of 4.
  const Index G = 24;
  const SparseMatrix A = grid(G, G), none(G * G, 0), nothing(0, G * G);
  const Elimination e = analyse(A, none, nothing, 0);
  EXPECT_LE(e.products, 4 * 31 * double(G * G * G));
  EXPECT_LE(e.largest_stack, 4 * G * G);
  std::vector<int> order = e.order;
  std::sort(order.begin(), order.end());
  for (Index i = 0; i < G * G; ++i) ASSERT_EQ(order[std::size_t(i)], i);
}

TEST(Elimination, FrontsHoldFewZeros) {
  // Entries of the fronts' columns against those of the Cholesky factor in the same order, counted by Eigen.
  const Index G = 60, m = G * G;
  const SparseMatrix A = grid(G, G), none(m, 0), nothing(0, m);
  const Elimination e = analyse(A, none, nothing, 0);
  Index held = 0;
  for (const Front& front : e.fronts)
    held += front.pivots * (front.pivots + 1) / 2 + front.pivots * Index(front.rest.size());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> to(m);
  for (Index i = 0; i < m; ++i) to.indices()[e.order[std::size_t(i)]] = int(i);
  const SparseMatrix negative = -A;
  SparseMatrix ordered;
  ordered = negative.twistedBy(to);
  const Eigen::SimplicialLLT<SparseMatrix, Eigen::Lower, Eigen::NaturalOrdering<int>> cholesky(ordered);
  const Index needed = SparseMatrix(cholesky.matrixL()).nonZeros();
  EXPECT_GE(held, needed);
  EXPECT_LE(15 * held, 16 * needed);
}

TEST(SparseSpectrum, SymmetricGrid) {
  const Index G = 20;
  const double dx = 1.0 / double(G + 1), s = std::sin(std::numbers::pi * dx / 2);
  const double fastest = 8 / (dx * dx) * (1 - s * s), slowest = 8 / (dx * dx) * s * s;
  const Spectrum stable = sparse_spectrum(grid(G, G));
  EXPECT_EQ(stable.half_angle, 0);
  EXPECT_EQ(stable.abscissa, 0);  // Gershgorin's bound
  // Ritz values lie inside the spectrum; 32 steps on 400 states find its end to a few percent.
  EXPECT_LE(stable.radius, fastest * (1 + 1e-12));
  EXPECT_GE(stable.radius, 0.9 * fastest);
  // Growth 50 moves the largest eigenvalue to 50 - slowest; the search finds it from above, within a factor of 2.
  const Spectrum unstable = sparse_spectrum(grid(G, G, 1, 0, 50));
  EXPECT_GE(unstable.abscissa, 50 - slowest);
  EXPECT_LE(unstable.abscissa, 2 * (50 - slowest));
  EXPECT_FALSE(unstable.real_negative());
  // Growth below `slowest`: the Gershgorin discs extend beyond 0, the eigenvalues do not.
  EXPECT_EQ(sparse_spectrum(grid(G, G, 1, 0, 0.5 * slowest)).abscissa, 0);
}

// A line of 600 finite elements with one row twice in both matrices. What rounding left of the pivot divided what it
// left of simple right sides.
TEST(SparseShift, ASingularPencilHasNoFactors) {
  const Index m = 600;
  const double c = double(m + 1) * double(m + 1) * 0.01, size = 3 * c;
  Triplets A, E;
  for (Index i = 0; i < m; ++i) {
    const Index row = i == 7 ? 6 : i;
    for (Index j = std::max<Index>(row - 1, 0); j <= std::min(row + 1, m - 1); ++j) {
      A.emplace_back(i, j, j == row ? -2 * c : c);
      E.emplace_back(i, j, j == row ? 4. / 6 : 1. / 6);
    }
  }
  const auto system =
      linear_system(SparseDynamics{assemble(m, m, A), SparseMatrix(m, 1), SparseMatrix(1, m), assemble(m, m, E)});
  for (const Complex z : {Complex(0.61, 0.83), Complex(-1.37, 0.29), Complex(1, 0.5)})
    EXPECT_FALSE(system->at_shift(z * size)) << z;
}

// A factorization of E that has no pivot was solved with.
TEST(SparseSpectrum, ASingularMassIsRefused) {
  SparseMatrix E(400, 400);
  E.setIdentity();
  E.coeffRef(7, 7) = 0;
  E.prune(0.5);
  EXPECT_THROW(sparse_spectrum(grid(20, 20), E), Error);
}

TEST(SparseSpectrum, SectorsAndSkewMatrices) {
  // Normal: blocks -a [[1, -tan], [tan, 1]], eigenvalues on the rays of 40 degrees.
  const double tangent = std::tan(40 * std::numbers::pi / 180);
  Triplets entries;
  for (Index i = 0; i < 150; ++i) {
    const double a = 1 + 0.1 * double(i);
    entries.insert(entries.end(), {{int(2 * i), int(2 * i), -a},
                                   {int(2 * i + 1), int(2 * i + 1), -a},
                                   {int(2 * i), int(2 * i + 1), a * tangent},
                                   {int(2 * i + 1), int(2 * i), -a * tangent}});
  }
  const Spectrum sector = sparse_spectrum(assemble(300, 300, entries));
  // The field of values is the convex hull of the eigenvalues: the estimate is close to 40 degrees and not above.
  EXPECT_LE(sector.half_angle, 40.001 * std::numbers::pi / 180);
  EXPECT_GE(sector.half_angle, 35 * std::numbers::pi / 180);
  EXPECT_LE(sector.radius, 15.9 / std::cos(40 * std::numbers::pi / 180) * (1 + 1e-12));
  EXPECT_GE(sector.radius, 0.9 * 15.9 / std::cos(40 * std::numbers::pi / 180));

  Triplets ring;
  for (Index i = 0; i < 300; ++i) {
    ring.emplace_back(i, (i + 1) % 300, 1.0);
    ring.emplace_back((i + 1) % 300, i, -1.0);
  }
  const Spectrum skew = sparse_spectrum(assemble(300, 300, ring));
  EXPECT_EQ(skew.half_angle, std::numbers::pi / 2);
  EXPECT_EQ(skew.abscissa, 0);
  EXPECT_LE(skew.radius, 2 + 1e-12);
  EXPECT_GE(skew.radius, 1.8);
}

}  // namespace
}  // namespace bromwich
