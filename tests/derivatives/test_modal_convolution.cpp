// The convolution of a Kronecker sum in modes, step by step, against sums over its lag weights from all eigenvalues;
// the response to x0 against exponentials; both transposed.

#include "core/derivatives/modal_convolution.hpp"

#include "core/catalogue/catalogue.hpp"
#include "core/kernel/recurrence.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich::modal_convolution_test {
namespace {

using reference::Random;

constexpr Index J = 35;  // no multiple of the rows that a response takes together
constexpr double T = 0.7, h = T / double(J);

KroneckerDynamics heat(double Q) { return *make_scene("signorini", {{"Q", Q}}).dynamics->modes(); }

RowMatrix convolved(const ModalConvolution& K, const RowMatrix& u) {
  RowMatrix v = RowMatrix::Zero(u.rows(), u.cols());
  ModalConvolution::State z = K.state();
  Vector a(u.cols());
  for (Index j = 1; j < u.rows(); ++j) {
    K.advance(j, u.row(j - 1).data(), z, a);
    v.row(j) = (a + K.own().cwiseProduct(u.row(j).transpose())).transpose();
  }
  return v;
}

RowMatrix transposed(const ModalConvolution& K, const RowMatrix& rho) {
  RowMatrix u = RowMatrix::Zero(rho.rows(), rho.cols());
  ModalConvolution::State zeta = K.state();
  Vector b(rho.cols());
  for (Index j = rho.rows() - 1; j >= 0; --j) {
    if (j + 1 < rho.rows()) {
      K.retreat(j, rho.row(j + 1).data(), zeta, b);
      u.row(j) = b.transpose();
    }
    if (j > 0) u.row(j) += K.own().transpose().cwiseProduct(rho.row(j));
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
    const RowMatrix rho = Random(3).matrix(J + 1, n), w = convolved(K, u);
    EXPECT_NEAR(dot(rho, w), dot(transposed(K, rho), u), 1e-14 * rho.norm() * w.norm()) << Q;
  }
}

TEST(ModalStart, IsTheSumOfAllExponentials) {
  const KroneckerDynamics d = heat(13);
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

}  // namespace
}  // namespace bromwich::modal_convolution_test
