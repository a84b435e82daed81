// Contract of Backend: marches with a dense state, against a loop over the lag table.

#include "tests/backends/march.hpp"

#include <cmath>

namespace bromwich {
namespace {

class BackendDenseMarch : public BackendMarch {
 protected:
  // Random M of class P, r, drive and y_0 with n constraints.
  void expect_as_in_a_loop(const Recurrence& recurrence, Index rows, Index n, bool driven, Random& random) {
    const LcpMatrix M = Matrix(random.dominant(n) + Matrix::Identity(n, n));
    const RowMatrix r = random.matrix(rows, n), drive = random.matrix(rows, n);
    const Vector y0 = random.vector(n).cwiseAbs();
    const Outcome found = march(M, LcpClass::P, recurrence, r, driven ? &drive : nullptr, y0);
    const Trajectory exact = loop(to_dense(M), lag_table(recurrence, rows - 1), r, driven ? &drive : nullptr, y0);
    EXPECT_LE(distance(found.y, exact.y), same) << n << (driven ? " driven" : "");
    EXPECT_LE(distance(found.v.bottomRows(rows - 1), exact.v.bottomRows(rows - 1)), same) << n;
    EXPECT_EQ(found.report.count.solved, rows - 1);
  }
};

INSTANTIATE_TEST_SUITE_P(Contract, BackendDenseMarch, testing::ValuesIn(backend_cases()), backend_case_name);

TEST_P(BackendDenseMarch, AgainstALoop) {
  const Index rows = 50;
  for (const auto& [n, m] : {std::pair<Index, Index>{1, 1}, {1, 4}, {3, 5}, {5, 2}, {17, 6}})
    for (const bool driven : {false, true}) {
      Random random{std::uint32_t(10 * n + m)};
      const DenseDynamics d{random.matrix(m, m) - Matrix(2 * Matrix::Identity(m, m)), random.matrix(m, n) / double(n),
                            random.matrix(n, m) / double(m)};
      const Recurrence recurrence = dense_recurrence(d, n % 2 ? Rule::exponential : Rule::implicit_euler, 0.02);
      expect_as_in_a_loop(recurrence, rows, n, driven, random);
    }
}

// A state large enough for blocks of time. Eigenvalues have real parts between -4 and 0, so nothing grows.
TEST_P(BackendDenseMarch, InBlocksAgainstALoop) {
  const Index rows = 300;
  for (const auto& [n, m] : {std::pair<Index, Index>{1, 48}, {3, 70}, {40, 60}})
    for (const bool driven : {false, true}) {
      Random random{std::uint32_t(10 * n + m)};
      const DenseDynamics d{2 / std::sqrt(double(m)) * random.matrix(m, m) - Matrix(2 * Matrix::Identity(m, m)),
                            random.matrix(m, n) / double(n), random.matrix(n, m) / double(m)};
      const Recurrence recurrence = dense_recurrence(d, n == 3 ? Rule::implicit_euler : Rule::exponential, 0.02);
      expect_as_in_a_loop(recurrence, rows, n, driven, random);
    }
}

// One mode of the state grows tenfold per step under feedback: blocks would cancel with 10^b. All operations are exact
// here.
TEST_P(BackendDenseMarch, WithoutBlocksWhereTheStateGrows) {
  const Index m = 64, rows = 200;
  DenseRecurrence r{0.5 * Matrix::Identity(m, m), Matrix::Zero(m, 1), Matrix::Zero(m, 1), Matrix::Zero(1, m),
                    Matrix::Zero(1, 1)};
  // w_j = y_j - z_{j-1}, so y_j = z_{j-1} while that is positive, and z_j = 10 z_{j-1} - 9 y_j = z_{j-1}.
  r.decay(0, 0) = 10;
  r.input(0, 0) = -9;
  r.start(0, 0) = 1;
  r.output(0, 0) = -1;
  const Outcome found =
      march(LcpMatrix(Matrix::Identity(1, 1)), LcpClass::P, r, RowMatrix::Zero(rows, 1), nullptr, Vector::Ones(1));
  EXPECT_EQ(found.y, RowMatrix::Ones(rows, 1));
}

}  // namespace
}  // namespace bromwich
