// Shifted solves of sparse dynamics on a device by cuDSS, where BROMWICH_CUDSS asks for it, and how it is looked for.

#include "core/base/error.hpp"
#include "core/dynamics/linear_system.hpp"
#include "core/dynamics/sparse.hpp"
#include "kernels/cudss.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/sparse_grids.hpp"

#include <Eigen/SparseLU>

namespace bromwich {
namespace {

using reference::Random;

TEST(LoadedCudss, SaysWhyItIsNotThere) {
  const cuda::LoadedCudss none = cuda::load_cudss("/nowhere/libcudss.so.1");
  EXPECT_FALSE(none.functions);
  EXPECT_NE(none.missing.find("/nowhere/libcudss.so.1"), std::string::npos) << none.missing;
  const cuda::LoadedCudss other = cuda::load_cudss("libm.so.6");
  EXPECT_FALSE(other.functions);
  EXPECT_EQ(other.missing, "libm.so.6 is no cuDSS: it has no cudssGetProperty");
}

class SparseOnDevice : public BothBackends {
 protected:
  void SetUp() override {
    BothBackends::SetUp();
    if (!IsSkipped() && !cuda::cudss().functions) GTEST_SKIP() << cuda::cudss().missing;
  }
};

/// Entries of a random pattern, `filled` per row on average.
SparseMatrix random_sparse(Random& random, Index rows, Index cols, double filled) {
  Triplets entries;
  for (Index i = 0; i < Index(double(rows) * filled); ++i)
    entries.emplace_back(Index(random.uniform(0, double(rows))), Index(random.uniform(0, double(cols))),
                         random.uniform());
  return assemble(rows, cols, entries);
}

// Column c of N (zE - A)^{-1} B by an LU factorization of Eigen.
ComplexVector direct(const SparseDynamics& d, Complex z, Index c) {
  Eigen::SparseMatrix<Complex> shifted(d.A.rows(), d.A.cols());
  if (d.E.rows() > 0)
    shifted = d.E.cast<Complex>();
  else
    shifted.setIdentity();
  shifted = z * shifted - d.A.cast<Complex>();
  shifted.makeCompressed();
  Eigen::SparseLU<Eigen::SparseMatrix<Complex>> lu(shifted);
  return d.N.cast<Complex>() * ComplexVector(lu.solve(ComplexVector(Vector(d.B.col(c)).cast<Complex>())));
}

TEST_F(SparseOnDevice, AgreesWithAFactorizationOfEveryNode) {
  Random random(4);
  const Index G = 70, m = G * G;
  const ComplexVector nodes{{Complex(1, 0), Complex(0.5, 3), Complex(-20, 60), Complex(-300, 500), Complex(2, 0.1)}};
  for (const bool wind : {false, true})
    for (const bool mass : {false, true})
      for (const auto& [n, k] : {std::pair<Index, Index>{3, 2}, {2, 40}, {40, 1}, {12, 12}}) {
        SparseDynamics d{wind ? grid(G, G, 1, 30) : grid(G, G), random_sparse(random, m, k, 3e-3),
                         random_sparse(random, n, m, 50)};
        if (mass) d.E = assemble(m, m, {{0, 0, 0.0}}) + SparseMatrix(Vector::LinSpaced(m, 1, 2).asDiagonal());
        // Twice: with an order of its own, and with the kept one.
        for (int call = 0; call < 2; ++call) {
          const ComplexMatrix found = cuda->resolvent(Dynamics(d), nodes);
          ASSERT_EQ(found.rows(), nodes.size());
          ASSERT_EQ(found.cols(), n * k);
          for (Index p = 0; p < nodes.size(); ++p)
            for (const Index c : {Index(0), k - 1}) {
              const ComplexVector exact = direct(d, nodes[p], c);
              // Two factorizations of matrices with condition numbers below 1e4, their entries up to 1e4.
              for (Index i = 0; i < n; ++i)
                EXPECT_LE(std::abs(found(p, i * k + c) - exact[i]), 1e-11 * (1 + exact.cwiseAbs().maxCoeff()))
                    << wind << mass << ' ' << n << " x " << k << ", node " << p << ", " << i << ' ' << c;
            }
        }
      }
}

TEST_F(SparseOnDevice, LeavesAnEigenvalueToTheHost) {
  const Index m = 5000;
  SparseDynamics d{SparseMatrix(Vector::LinSpaced(m, -double(m), -1).asDiagonal()), SparseMatrix(m, 1),
                   SparseMatrix(1, m)};
  d.B = Vector::Ones(m).sparseView();
  d.N = Matrix::Ones(1, m).sparseView();
  const auto at = [&](Complex node) { return cuda->resolvent(Dynamics(d), ComplexVector{{Complex(1, 1), node}}); };
  EXPECT_NO_THROW(at(Complex(-7, 1e-2)));
  EXPECT_THROW(at(-7), SingularShift);
}

}  // namespace
}  // namespace bromwich
