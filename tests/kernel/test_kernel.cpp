// Kernels from contours against sums over eigenvalues in extended precision and dense factorizations.

#include "core/kernel/kernel.hpp"
#include "core/numerics/orthogonal_factor.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/run.hpp"

#include <Eigen/Dense>

namespace bromwich {
namespace {

using reference::Real;
using reference::signorini_dynamics;

TEST(LagWindows, CoverAllLagsWithinTheirContours) {
  const ContourParameters parameters = *contour_parameters(0);
  for (const Index J : {0, 1, 2, 4, 5, 24, 400, 4096}) {
    const double h = 0.01;
    Index next = 0;
    for (const LagWindow& window : lag_windows(parameters, h, J)) {
      EXPECT_EQ(window.first, next);
      EXPECT_GE(window.last, window.first);
      // Lag d uses kernel values in [(d-1)h, (d+1)h]; lags 0 and 1 use [h, 2h].
      EXPECT_GE(h * double(std::max<Index>(window.first - 1, 1)), window.contour.t0 * (1 - 4 * epsilon));
      EXPECT_LE(h * double(window.last + 1), window.contour.t1 * (1 + 4 * epsilon));
      EXPECT_EQ(window.F.rows(), window.last - window.first + 1);
      next = window.last + 1;
    }
    EXPECT_EQ(next, J + 1);
  }
}

TEST(ContourLagTable, SignoriniWeightsTo1e12) {
  const auto backend = make_cpu_backend(1);
  const ContourParameters parameters = *contour_parameters(0, 1e-12);
  ASSERT_LE(parameters.P + 1, 22);
  for (const Index Q : {1, 7, 39, 127})
    for (const Index J : {1, 2, 5, 400}) {
      const KroneckerDynamics d = signorini_dynamics(Q, Q);
      const double h = 4.0 / double(J);
      const LagTable table = contour_lag_table(*backend, d, parameters, h, J);
      const LagTable exact = reference::modal_weights(d, h, J, Q > 50 ? 5 : 1);
      const double scale = exact.W.cwiseAbs().maxCoeff();
      double W = 0, S = 0;
      for (Index l = 0; l<Q; l += Q> 50 ? 5 : 1) {
        W = std::max(W, (table.W.col(l) - exact.W.col(l)).cwiseAbs().maxCoeff());
        S = std::max(S, (table.S.col(l) - exact.S.col(l)).cwiseAbs().maxCoeff());
      }
      // The contour gives e^{at} to 2.4e-13 of 1, and the weights are averages of the kernel over two steps.
      EXPECT_LE(W, 1e-12 * scale) << "Q = " << Q << ", J = " << J;
      EXPECT_LE(S, 1e-12 * scale) << "Q = " << Q << ", J = " << J;
      EXPECT_TRUE(table.modal);
      EXPECT_EQ(table.S.row(0).cwiseAbs().maxCoeff(), 0);
    }
}

TEST(ContourLagTable, DenseSymmetricMatrix) {
  const auto backend = make_cpu_backend(1);
  const ContourParameters parameters = *contour_parameters(0, 1e-12);
  reference::Random random(11);
  const Index m = 20, n = 3;
  const Matrix V = orthogonal_factor(random.matrix(m, m).householderQr().householderQ());
  Vector lambda(m);
  for (Index i = 0; i < m; ++i) lambda[i] = i == 0 ? 0 : -std::pow(10.0, random.uniform(-2, 4));
  const DenseDynamics d{V * lambda.asDiagonal() * V.transpose(), random.matrix(m, n), random.matrix(n, m)};
  for (const Index J : {1, 5, 130}) {
    const double h = 2.0 / double(J);
    const LagTable table = contour_lag_table(*backend, d, parameters, h, J);
    ASSERT_FALSE(table.modal);
    // Entries of the kernel are at most ||N|| ||B||, the weights h times that; e^{at} is good to 2.4e-13.
    const double tolerance = 1e-12 * h * d.N.norm() * d.B.norm();
    for (Index lag = 0; lag <= J; ++lag) {
      Vector W(m), S(m);
      for (Index i = 0; i < m; ++i) {
        const Real x = Real(h) * Real(lambda[i]), p1 = reference::phi1(x), p2 = reference::phi2(x);
        const Real decay = std::exp(Real(lag - 1) * x);
        W[i] = double(Real(h) * (lag == 0 ? p2 : decay * p1 * p1));
        S[i] = lag == 0 ? 0 : double(Real(h) * decay * (p1 - p2));
      }
      const auto block = [&](const RowMatrix& rows) { return Eigen::Map<const RowMatrix>(rows.row(lag).data(), n, n); };
      const Matrix left = d.N * V, right = V.transpose() * d.B;
      EXPECT_LE((block(table.W) - left * W.asDiagonal() * right).cwiseAbs().maxCoeff(), tolerance) << J << ' ' << lag;
      EXPECT_LE((block(table.S) - left * S.asDiagonal() * right).cwiseAbs().maxCoeff(), tolerance) << J << ' ' << lag;
    }
  }
}

using LongComplex = std::complex<Real>;
using LongMatrix = Eigen::Matrix<LongComplex, Eigen::Dynamic, Eigen::Dynamic>;
using LongVector = Eigen::Matrix<LongComplex, Eigen::Dynamic, 1>;

/// n^T (zI - across)^{-1} by a dense LU.
LongVector resolvent_row(const SecondDifference& d, const Vector& n, Complex z) {
  const Index Q = d.points;
  const Real s = Real(d.diffusivity) / (Real(d.spacing) * Real(d.spacing));
  LongMatrix shifted = LongMatrix::Zero(Q, Q);
  for (Index i = 0; i < Q; ++i) {
    shifted(i, i) = LongComplex(z.real(), z.imag()) + 2 * s;
    if (i > 0) shifted(i, i - 1) = shifted(i - 1, i) = -s;
  }
  LongVector right(Q);
  for (Index i = 0; i < Q; ++i) right[i] = LongComplex(Real(n[i]));
  return shifted.partialPivLu().solve(right);  // symmetric
}

TEST(LineResolvent, ClosedFormAgainstDenseLu) {
  reference::Random random(5);
  for (const Index Q : {1, 2, 7, 64}) {
    const SecondDifference across{Q, 1.0 / double(Q + 1), 2e-3};
    Vector first = Vector::Zero(Q);
    first[0] = -2;
    std::vector<Complex> shifts{
        1e-8, 1e-3, 1.0, 1e8, Complex(0, 1e-4), Complex(-1, 1e-2), Complex(-5, 7), Complex(-1e4, 2e4)};
    const Contour contour = window_contour(*contour_parameters(0), 0.04);
    for (Index p = 0; p < contour.nodes.size(); p += 5) shifts.push_back(contour.nodes[p]);
    for (const Complex z : shifts)
      for (const Vector& n : {first, random.vector(Q)}) {
        const LongVector exact = resolvent_row(across, n, z);
        const Vector b = random.vector(Q);
        // z itself is exact. A relative perturbation eps of z changes the resolvent by eps |z| / distance to the
        // spectrum; the closed form has the rounding error of a few such perturbations.
        double distance = std::abs(z);
        for (const double lambda : across.eigenvalues()) distance = std::min(distance, std::abs(z - lambda));
        const double condition = std::abs(z) / distance + 1, largest = double(exact.cwiseAbs().maxCoeff());
        const double tolerance = 64 * epsilon * condition * largest * n.cwiseAbs().sum();
        const ComplexVector row = green_row(across, n, z);
        EXPECT_LE(double((row.cast<LongComplex>() - exact).cwiseAbs().maxCoeff()), tolerance) << Q << ' ' << z;
        const LongComplex transfer = (exact.transpose() * b.cast<LongComplex>())(0, 0);
        EXPECT_LE(double(std::abs(LongComplex(LineTransfer(across, n, b)(z)) - transfer)),
                  tolerance * b.cwiseAbs().sum())
            << Q << ' ' << z;
      }
  }
}

TEST(ContourInitialResponse, AgainstDenseExponentials) {
  for (const auto& [along, across] : {std::pair<Index, Index>{1, 1}, {5, 7}, {8, 3}}) {
    reference::Random random{std::uint32_t(along)};
    KroneckerDynamics d = signorini_dynamics(along, across, 0.05);
    d.n = random.vector(across);
    const Vector x0 = random.vector(along * across);
    const Matrix S = reference::sine_matrix(along);
    const RowMatrix lines = S * Eigen::Map<const RowMatrix>(x0.data(), along, across);
    const Index J = 30;
    const double h = 0.02;
    const RowMatrix response = contour_initial_response(d, *contour_parameters(0), lines, h, J);
    const DenseDynamics dense = to_dense(Dynamics(d));
    const Matrix step = oracle::exponential(h * dense.A);
    Vector x = x0;
    for (Index j = 0; j <= J; ++j, x = step * x)
      // e^{at} to 7e-15 on every mode, up to 30 dense products.
      EXPECT_LE((response.row(j).transpose() - S * (dense.N * x)).cwiseAbs().maxCoeff(), 1e-13 * d.n.norm() * x0.norm())
          << along << " x " << across << ", row " << j;
  }
}

}  // namespace
}  // namespace bromwich
