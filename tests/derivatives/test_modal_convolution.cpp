// The convolution of a Kronecker sum in modes, step by step, against sums over its lag weights from all eigenvalues;
// the response to x0 against exponentials; both transposed.

#include "derivatives/modal_convolution.hpp"
#include "derivatives/modal_start.hpp"

#include "catalogue/catalogue.hpp"
#include "core/kernel/recurrence.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich::modal_convolution_test {
namespace {

using reference::Random;

constexpr Index J = 35;  // no multiple of the time points that are taken together
constexpr double T = 0.7, h = T / double(J);

KroneckerDynamics heat(double Q) { return *make_scene("signorini", {{"Q", Q}}).dynamics->modes(); }

// Filled up with zeros.
Vector row_of(const RowMatrix& table, Index j, Index width) {
  Vector row = Vector::Zero(width);
  row.head(table.cols()) = table.row(j).transpose();
  return row;
}

RowMatrix convolved(const ModalConvolution& K, const RowMatrix& u) {
  RowMatrix v = RowMatrix::Zero(u.rows(), u.cols());
  ModalConvolution::State z = K.state();
  Vector a(K.width());
  for (Index j = 1; j < u.rows(); ++j) {
    const Vector before = row_of(u, j - 1, K.width());
    j == 1 ? K.start(before.data(), z, a.data()) : K.advance(before.data(), z, a.data());
    v.row(j) = (a.head(u.cols()) + K.own().cwiseProduct(u.row(j).transpose())).transpose();
  }
  return v;
}

RowMatrix transposed(const ModalConvolution& K, const RowMatrix& rho) {
  RowMatrix u = RowMatrix::Zero(rho.rows(), rho.cols());
  ModalConvolution::State zeta = K.state();
  Vector b(K.width());
  for (Index j = rho.rows() - 1; j > 0; --j) {
    u.row(j) += K.own().transpose().cwiseProduct(rho.row(j));
    const Vector after = row_of(rho, j, K.width());
    j > 1 ? K.advance(after.data(), zeta, b.data()) : K.finish(after.data(), zeta, b.data());
    u.row(j - 1) += b.head(rho.cols()).transpose();
  }
  return u;
}

double dot(const RowMatrix& a, const RowMatrix& b) { return a.cwiseProduct(b).sum(); }

// All eigenvalues (Q = 13), and a short sum in their place (Q = 100).
TEST(ModalConvolution, IsTheSumOverLags) {
  for (const double Q : {13.0, 100.0}) {
    const KroneckerDynamics d = heat(Q);
    const ModalConvolution K(d, h, T);
    EXPECT_EQ(K.exponentials() < Index(Q), Q > 40) << K.exponentials();
    const Index n = d.face_points();
    const LagTable lags = lag_table(Recurrence(modal_recurrence(d, Rule::exponential, h, RowMatrix())), J);
    const RowMatrix u = Random(2).matrix(J + 1, n);
    RowMatrix v = RowMatrix::Zero(J + 1, n);
    for (Index j = 1; j <= J; ++j) {
      v.row(j) = lags.S.row(j).cwiseProduct(u.row(0));
      for (Index i = 1; i <= j; ++i) v.row(j) += lags.W.row(j - i).cwiseProduct(u.row(i));
    }
    // The fit errs by 1e-11 of the kernel at most, times J lags.
    const double error = (convolved(K, u) - v).cwiseAbs().maxCoeff();
    EXPECT_LE(error, (Q > 40 ? 1e-11 : 1e-14) * double(J) * lags.W.cwiseAbs().maxCoeff()) << Q;
    // Backwards, for every number of values that wait for the others when the pass ends.
    for (Index rows = J - 3; rows <= J; ++rows) {
      const RowMatrix rho = Random(3).matrix(rows + 1, n), part = u.topRows(rows + 1), w = convolved(K, part);
      EXPECT_NEAR(dot(rho, w), dot(transposed(K, rho), part), 1e-14 * rho.norm() * w.norm()) << Q << ", " << rows;
    }
  }
}

// Also on a fine line, where most exponentials are left out after a few time points.
TEST(ModalStart, IsTheSumOfAllExponentials) {
  for (const double Q : {13.0, 200.0}) {
    const KroneckerDynamics d = heat(Q);
    const ModalStart start(d, h);
    const Vector mu = d.face_eigenvalues(), nu = d.across.eigenvalues(), seen = d.across.in_modes(d.n);
    const RowMatrix x0 = Random(4).matrix(nu.size(), mu.size());
    RowMatrix v = RowMatrix::Zero(J + 1, mu.size());
    for (Index j = 0; j <= J; ++j)
      for (Index k = 0; k < nu.size(); ++k)
        v.row(j).array() += seen[k] * x0.row(k).array() * (h * double(j) * (mu.array() + nu[k])).exp().transpose();
    const RowMatrix found = start.response(x0, J);
    EXPECT_LE((found - v).cwiseAbs().maxCoeff(), 1e-13 * v.cwiseAbs().maxCoeff());  // J products
    const RowMatrix rho = Random(5).matrix(J + 1, mu.size());
    EXPECT_NEAR(dot(rho, found), dot(start.transposed(rho), x0), 1e-14 * rho.norm() * found.norm());
  }
}

}  // namespace
}  // namespace bromwich::modal_convolution_test
