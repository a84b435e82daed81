// Contract of Backend: arrays, sine transforms and shifted solves.

#include "core/base/error.hpp"
#include "core/numerics/contour.hpp"
#include "tests/support/backends.hpp"

#include <Eigen/Dense>

#include <map>
#include <string>
#include <utility>

namespace bromwich {
namespace {

using reference::Random;

INSTANTIATE_TEST_SUITE_P(Contract, BackendTest, testing::ValuesIn(backend_cases()), backend_case_name);

TEST_P(BackendTest, ArraysStartAtZeroAndKeepWhatTheyGet) {
  for (const auto& [rows, cols] : {std::pair<Index, Index>{1, 1}, {3, 7}, {128, 9}}) {
    const auto array = backend->array(rows, cols);
    EXPECT_EQ(array->rows(), rows);
    EXPECT_EQ(array->cols(), cols);
    EXPECT_EQ(array->bytes(), sizeof(double) * std::size_t(rows * cols));
    EXPECT_EQ(host(*array), RowMatrix::Zero(rows, cols));
    const RowMatrix values = Random(1).matrix(rows, cols);
    backend->upload(values, *array);
    EXPECT_EQ(host(*array), values);
  }
  EXPECT_FALSE(backend->name().empty());
  EXPECT_GE(backend->device().threads, 1);
}

const std::vector<Index> transform_sizes{1, 2, 3, 8, 39, 64, 127, 128, 511, 1200};

const Matrix& sine_matrix(Index n) {
  static std::map<Index, Matrix> kept;
  auto& S = kept[n];
  if (S.size() == 0) S = reference::sine_matrix(n);
  return S;
}

/// n products of entries sqrt(2/(n+1)) with values up to 1, summed in any order: error below n eps sqrt(2/n). Fast
/// transforms are more accurate.
double transform_tolerance(Index n) { return 4 * epsilon * std::sqrt(2.0 * double(n)); }

TEST_P(BackendTest, SineTransformEqualsTheDenseMatrix) {
  for (const Index n : transform_sizes)
    for (const Index rows : {1, 2, 37}) {
      const RowMatrix values = Random(std::uint32_t(n)).matrix(rows, n), addend = Random(9).matrix(rows, n);
      const RowMatrix exact = values * sine_matrix(n);
      const auto in = device(values), add = device(addend), out = backend->array(rows, n);
      const auto sine = backend->sine_transform(n, rows);
      sine->apply(*in, nullptr, *out, 0);
      EXPECT_LE(distance(host(*out), exact), transform_tolerance(n)) << n << ' ' << rows;
      sine->apply(*in, add.get(), *out, 0);
      EXPECT_LE(distance(host(*out), addend + exact), transform_tolerance(n) + 4 * epsilon) << n << ' ' << rows;
      sine->apply(*in, add.get(), *add, 0);  // out may be add
      EXPECT_LE(distance(host(*add), addend + exact), transform_tolerance(n) + 4 * epsilon) << n << ' ' << rows;
      EXPECT_EQ(host(*in), values) << "the input is not touched";
    }
}

TEST_P(BackendTest, SineTransformIsItsOwnInverse) {
  for (const Index n : transform_sizes) {
    const RowMatrix values = Random(2).matrix(5, n);
    const auto in = device(values), out = backend->array(5, n);
    const auto sine = backend->sine_transform(n, 5);
    sine->apply(*in, nullptr, *out, 0);
    // An isometry: the error of the first transform keeps its 2-norm, at most sqrt(n) times its largest entry.
    EXPECT_NEAR(host(*out).norm(), values.norm(), 8 * epsilon * std::sqrt(double(n)) * values.norm()) << n;
    sine->apply(*out, nullptr, *in, 0);
    EXPECT_LE(distance(host(*in), values), 2 * std::sqrt(double(n)) * transform_tolerance(n)) << n;
  }
}

TEST_P(BackendTest, SineTransformLeavesRowsBeforeFirst) {
  for (const Index n : {3, 64, 1200})
    for (const Index first : {0, 1, 33, 40}) {
      const Index rows = 40;
      const RowMatrix values = Random(3).matrix(rows, n), before = Random(4).matrix(rows, n);
      const auto in = device(values), out = device(before);
      backend->sine_transform(n, rows)->apply(*in, nullptr, *out, first);
      const RowMatrix result = host(*out);
      EXPECT_EQ(result.topRows(first), before.topRows(first)) << n << ' ' << first;
      if (first == rows) continue;
      EXPECT_LE(distance(result.bottomRows(rows - first), (values * sine_matrix(n)).bottomRows(rows - first)),
                transform_tolerance(n))
          << n << ' ' << first;
    }
}

ComplexVector nodes_of_a_window() { return window_contour(*contour_parameters(0), 0.1).nodes; }

/// N (zI - A)^{-1} B.
ComplexMatrix shifted_solve(const DenseDynamics& d, Complex z) {
  const Index m = d.A.rows();
  const ComplexMatrix shifted = z * ComplexMatrix::Identity(m, m) - d.A.cast<Complex>();
  return d.N.cast<Complex>() * shifted.fullPivLu().solve(d.B.cast<Complex>().eval());
}

TEST_P(BackendTest, ResolventOfDenseMatrices) {
  struct Shape {
    Index m, n, k;  // states, rows of N, columns of B
  };
  for (const auto [m, n, k] : {Shape{1, 1, 1}, {2, 2, 1}, {7, 3, 5}, {7, 5, 2}, {33, 2, 2}, {200, 1, 4}}) {
    Random random{5u};
    // Eigenvalues in a disk of radius 1 around -2; nodes to its right or far away.
    const Matrix A = random.matrix(m, m) / std::sqrt(double(m)) - Matrix(2 * Matrix::Identity(m, m));
    const DenseDynamics d{A, random.matrix(m, k), random.matrix(n, m)};
    const ComplexVector nodes = m < 100 ? nodes_of_a_window() : ComplexVector(nodes_of_a_window().head(2));
    const ComplexMatrix R = backend->resolvent(d, nodes);
    ASSERT_EQ(R.rows(), nodes.size());
    ASSERT_EQ(R.cols(), n * k);
    for (Index p = 0; p < nodes.size(); ++p) {
      const ComplexMatrix exact = shifted_solve(d, nodes[p]);
      for (Index i = 0; i < n; ++i)
        for (Index j = 0; j < k; ++j)
          // Two factorizations of matrices with a condition number below 1e3.
          EXPECT_LE(std::abs(R(p, i * k + j) - exact(i, j)), 1e-12) << m << ", node " << p;
    }
  }
}

TEST_P(BackendTest, ResolventRefusesAnEigenvalue) {
  const auto diagonal = [](Index m) { return Matrix(Vector::LinSpaced(m, -double(m), -1).asDiagonal()); };
  // Pivots that are zero without rounding.
  for (const auto& [A, z] : {std::pair<Matrix, double>{diagonal(1), -1},
                             {diagonal(3), -2},
                             {Matrix{{-2, 1}, {1, -2}}, -1},
                             {diagonal(50), -7}}) {
    const Dynamics d = DenseDynamics{A, Matrix::Ones(A.rows(), 1), Matrix::Ones(1, A.rows())};
    const auto at = [&](Complex node) { backend->resolvent(d, ComplexVector{{Complex(1, 1), node}}); };
    EXPECT_NO_THROW(at(Complex(z, 1e-3))) << A.rows();
    try {
      at(z);
      ADD_FAILURE() << "an eigenvalue of " << A.rows();
    } catch (const Error& error) {
      EXPECT_TRUE(std::string(error.what()).starts_with("resolvent: found an eigenvalue of A at or next to the node -"))
          << error.what();
    }
  }
}

// Row p: the diagonal of S N (z_p I - A)^{-1} B S; the rest must vanish.
void expect_modes(const KroneckerDynamics& d, const ComplexVector& nodes, const ComplexMatrix& R, double tolerance) {
  const Index n = d.along.points;
  const Matrix& S = sine_matrix(n);
  const DenseDynamics dense = to_dense(Dynamics(d));
  ASSERT_EQ(R.rows(), nodes.size());
  ASSERT_EQ(R.cols(), n);
  for (Index p = 0; p < nodes.size(); ++p) {
    const ComplexMatrix modes = S.cast<Complex>() * shifted_solve(dense, nodes[p]) * S.cast<Complex>();
    EXPECT_LE((modes - ComplexMatrix(R.row(p).asDiagonal())).cwiseAbs().maxCoeff(), tolerance)
        << n << " x " << d.across.points << ", node " << p;
  }
}

TEST_P(BackendTest, ResolventOfKroneckerSums) {
  const ComplexVector nodes = nodes_of_a_window();
  for (const auto& [along, across] : {std::pair<Index, Index>{1, 1}, {1, 6}, {2, 5}, {7, 3}, {8, 8}}) {
    KroneckerDynamics d = reference::signorini_dynamics(along, across, 0.05);
    // |N (zI-A)^{-1} B| <= 2 c/dx^2 / distance: below 10; the matrices' condition numbers are below 1e2.
    expect_modes(d, nodes, backend->resolvent(d, nodes), 1e-13);
    // Constraints that use all points of their line: |n| |b| / distance is smaller still.
    Random random{std::uint32_t(across)};
    d.n = random.vector(across);
    d.b = random.vector(across);
    if (across > 2) d.n[1] = 0;
    expect_modes(d, nodes, backend->resolvent(d, nodes), 1e-13);
  }
}

TEST_P(BackendTest, ResolventOfFineLinesAtSmallShifts) {
  // |z - mu| dx^2/c from 1e-3 on, where the logarithm of rho would lose digits.
  const KroneckerDynamics d = reference::signorini_dynamics(1, 64);
  const ComplexVector nodes{{Complex(1e-3, 0), Complex(1e-3, 2e-3), Complex(-1e-3, 1e-2), Complex(0.05, 0)}};
  // Condition numbers of 4c/dx^2 over a distance of 0.02 to the spectrum: 2e3, times 64 roundings; values below 2.
  expect_modes(d, nodes, backend->resolvent(d, nodes), 3e-11);
}

}  // namespace
}  // namespace bromwich
