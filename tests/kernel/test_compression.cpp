// Short sums of exponentials against the exact sum over all eigenvalues of a line.

#include "core/kernel/compression.hpp"
#include "core/kernel/response.hpp"
#include "core/multigrid/time_levels.hpp"
#include "core/numerics/sine_basis.hpp"
#include "core/scene/separable.hpp"
#include "core/seam/upload.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/run.hpp"

namespace bromwich {
namespace {

using reference::Real;
using reference::signorini_dynamics;

constexpr double tolerance = 1e-12;

/// n^T e^{across t} b.
Real line_kernel(const KroneckerDynamics& d, const std::vector<Real>& coefficients, Real t) {
  Real sum = 0;
  for (Index k = 0; k < d.across.points; ++k) {
    const Real exponent = reference::eigenvalue(d.across, k + 1) * t;
    if (exponent < -60) break;  // eigenvalues decrease; e^{-60} is 1e-26
    sum += coefficients[std::size_t(k)] * std::exp(exponent);
  }
  return sum;
}

TEST(Compression, ReproducesTheLineKernel) {
  for (const Index Q : {3, 39, 127, 511})
    for (const Index J : {10, 400, 4096}) {
      const KroneckerDynamics d = signorini_dynamics(Q, Q);
      const std::vector<Real> coefficients = reference::line_coefficients(d);
      const double T = 4, h = T / double(J);
      const ExponentialSum sum = compress_line_kernel(d, h, T, 1e-13);
      EXPECT_LT(sum.rates.size(), 64) << Q << ' ' << J;
      EXPECT_LE(sum.rates.maxCoeff(), 0);
      double worst = 0, largest = 0;
      const int points = 400;
      for (int i = 0; i <= points; ++i) {
        const double t = i == points ? T : h * std::pow(T / h, double(i) / points);
        double fitted = 0;
        for (Index k = 0; k < sum.rates.size(); ++k) fitted += sum.coefficients(k, 0) * std::exp(sum.rates[k] * t);
        const double exact = double(line_kernel(d, coefficients, t));
        worst = std::max(worst, std::abs(fitted - exact));
        largest = std::max(largest, std::abs(exact));
      }
      // Ten steps from h on span a window of ratio 10 only, in which exponentials of 511 rates are nearly dependent:
      // the fit stops at 2.3e-12 whatever the number of rates.
      const double allowed = Q == 511 && J == 10 ? 5e-12 : tolerance;
      EXPECT_LE(worst, allowed * largest) << "Q = " << Q << ", J = " << J << ", K = " << sum.rates.size();
      // Its own error estimate uses fewer points, and contour values accurate to 1e-14.
      EXPECT_LE(worst, (4 * sum.error + 1e-13) * largest) << "Q = " << Q << ", J = " << J;
    }
}

TEST(Compression, WeightsOfTheRecurrence) {
  const auto backend = make_cpu_backend(1);
  for (const auto& [Q, J] : {std::pair<Index, Index>{3, 10}, {39, 400}, {127, 400}, {511, 64}}) {
    const KroneckerDynamics d = signorini_dynamics(Q, Q);
    const double T = 4, h = T / double(J);
    const ModalRecurrence r = compressed_recurrence(*backend, d, compress_line_kernel(d, h, T, 1e-13), h);
    const LagTable table = lag_table(r, J);
    const Index stride = Q > 50 ? 17 : 1;
    const LagTable exact = reference::modal_weights(d, h, J, stride);
    // Weights are averages of the kernel over [(d-1)h, (d+1)h]: lags 0 and 1 from the contour, the others within [h, T]
    // to 1e-12 of the largest kernel value there, which is a few times W_2/h at most.
    const double scale = tolerance * exact.W.cwiseAbs().maxCoeff();
    for (Index l = 0; l < Q; l += stride) {
      EXPECT_LE((table.W.col(l) - exact.W.col(l)).cwiseAbs().maxCoeff(), scale) << "Q = " << Q << ", mode " << l;
      EXPECT_LE((table.S.col(l) - exact.S.col(l)).cwiseAbs().maxCoeff(), scale) << "Q = " << Q << ", mode " << l;
    }
  }
}

TEST(Compression, ModalRecurrenceSaysTheSame) {
  const auto backend = make_cpu_backend(1);
  const KroneckerDynamics d = signorini_dynamics(31, 31);
  const Index J = 100;
  const double h = 0.04;
  const ExponentialSum sum = compress_line_kernel(d, h, 4, 1e-13);
  const LagTable compressed = lag_table(compressed_recurrence(*backend, d, sum, h), J);
  const LagTable modal = lag_table(modal_recurrence(d, Rule::exponential, h, {}), J);
  EXPECT_LE(distance(compressed.W, modal.W), tolerance * modal.W.cwiseAbs().maxCoeff());
  EXPECT_LE(distance(compressed.S, modal.S), tolerance * modal.W.cwiseAbs().maxCoeff());
}

RowMatrix coefficients(Backend& backend, const InitialFit& fit, const Vector& x0) {
  RowMatrix D;
  backend.download((*fit.project)(x0), D);
  return D;
}

// N e^{At} x0 in mode l is Σ_k n_k x_lk e^{(nu_k + mu_l) t}: smooth, rough and single modes of x0.
TEST(Compression, InitialStatesInTheSameExponentials) {
  const double T = 4;
  const auto backend = make_cpu_backend(2);
  for (const auto& [Q, J] : {std::pair<Index, Index>{3, 10}, {39, 400}, {127, 4096}}) {
    const KroneckerDynamics d = signorini_dynamics(Q, Q);
    const Vector mu = d.along.eigenvalues(), nu = d.across.eigenvalues(), seen = in_sine_basis(d.n);
    const double h = T / double(J);
    const Matrix S = sine_matrix(Q);
    const ExponentialSum sum = compress_line_kernel(d, h, T);
    RowMatrix smooth(Q, Q), single = RowMatrix::Zero(Q, Q);
    for (Index l = 0; l < Q; ++l)
      for (Index k = 0; k < Q; ++k) smooth(l, k) = 1 / std::pow(double((l + 1) * (k + 1)), 3);
    single(0, Q / 2) = 1;
    for (const RowMatrix& modes : {smooth, single, RowMatrix(RowMatrix::Random(Q, Q))}) {
      const RowMatrix state = S * modes * S;  // line by line
      const Vector x0 = Eigen::Map<const Vector>(state.data(), Q * Q);
      const InitialFit fit = fit_initial_response(*backend, d, sum, h, T);
      const RowMatrix D = coefficients(*backend, fit, x0);
      const double error = initial_error(*backend, d, fit, x0);
      EXPECT_LE(error, accepted_compression_error) << Q;
      const RowMatrix parts = modes * seen.asDiagonal();
      const double size = parts.colwise().norm().sum();
      for (int i = 0; i <= 50; ++i) {
        const double t = h * std::pow(T / h, i / 50.0);
        Vector gap(Q);
        for (Index l = 0; l < Q; ++l)
          gap[l] = parts.row(l).dot(((nu.array() + mu[l]) * t).exp().matrix()) -
                   D.col(l).dot(((sum.rates.array() + mu[l]) * t).exp().matrix());
        EXPECT_LE(gap.norm(), (error + 1e-13) * size) << "Q = " << Q << ", t = " << t;  // sums of Q parts are rounded
      }
    }
  }
}

// A recurrence that starts from x0 gives its response at all time points, on the grid of the fit and on a coarser one.
TEST(Compression, StartedRecurrence) {
  const auto backend = make_cpu_backend(1);
  const Index Q = 31, J = 100;
  const KroneckerDynamics d = signorini_dynamics(Q, Q);
  const double T = 4, h = T / double(J);
  const Vector x0 = Vector::Random(Q * Q);
  const ExponentialSum sum = compress_line_kernel(d, h, T);
  const RowMatrix D = coefficients(*backend, fit_initial_response(*backend, d, sum, h, T), x0);
  const RowMatrix lines = x0_in_modes(*backend, d, x0, false);
  for (const Index ratio : {1, 2}) {
    const Index rows = J / ratio + 1;
    ModalRecurrence r = compressed_recurrence(*backend, d, sum, h);
    if (ratio == 2) r = coarsen(r);
    const auto with_x0 = started(r, D);
    ASSERT_TRUE(with_x0);
    const auto y = backend->array(rows, Q), v = backend->array(rows, Q);
    backend->convolution(*with_x0, rows)->apply(*y, *v, 0);
    RowMatrix response;
    backend->download(*v, response);
    RowMatrix exact = contour_initial_response(d, *contour_parameters(0), lines, h * double(ratio), J / ratio);
    exact.row(0).setZero();
    EXPECT_LE(distance(response, exact), tolerance * lines.cwiseAbs().maxCoeff() * d.n.cwiseAbs().sum() * double(Q));
  }
}

TEST(SeparableSource, IsWhatItSaysAtEveryTime) {
  const Index width = 5;
  const SeparableSource source{Matrix::Random(width, 2),
                               [](double t, Eigen::Ref<Vector> a) { a << std::cos(t), t * t; }};
  const TimeFunction function = source, opaque = [&](double t, Eigen::Ref<Vector> value) { source(t, value); };
  const Vector t = time_grid(3, 40);
  const SampledSource factors = sample(function, t, width), one_by_one = sample(opaque, t, width);
  const RowMatrix& table = factors.table();
  for (Index j = 0; j <= 40; ++j) {
    const Vector exact = std::cos(t[j]) * source.shapes.col(0) + t[j] * t[j] * source.shapes.col(1);
    EXPECT_LE((table.row(j).transpose() - exact).cwiseAbs().maxCoeff(), 4 * epsilon * 10);
  }
  const double rounding = 4 * epsilon * 10;
  EXPECT_LE(distance(table, one_by_one.table()), rounding);
  const Vector shift = Vector::Random(width);
  const auto backend = make_cpu_backend(2);
  for (const SampledSource* s : {&factors, &one_by_one}) {
    EXPECT_EQ(s->rows(), 41);
    EXPECT_EQ(s->cols(), width);
    EXPECT_EQ(s->not_finite(), -1);
    EXPECT_LE((s->row(7) - table.row(7).transpose()).cwiseAbs().maxCoeff(), rounding);
    EXPECT_LE(distance(s->rows(4, 7, 5).table(), table(Eigen::seqN(4, 7, 5), Eigen::all)), rounding);
    EXPECT_LE(distance(s->plus(shift).table(), table.rowwise() + shift.transpose()), rounding);
    const auto array = backend->array(41, width);
    upload(*backend, *s, *array);
    RowMatrix uploaded;
    backend->download(*array, uploaded);
    EXPECT_LE(distance(uploaded, table), rounding);
  }
}

TEST(SeparableSource, WithoutShapesIsZero) {
  const TimeFunction none = SeparableSource{Matrix(3, 0), [](double, Eigen::Ref<Vector>) {}};
  EXPECT_EQ(sample(none, time_grid(1, 4), 3).table(), RowMatrix::Zero(5, 3));
}

TEST(SeparableSource, SaysWhereItIsNotFinite) {
  RowMatrix amplitudes = RowMatrix::Ones(9, 2);
  amplitudes(6, 1) = INFINITY;
  EXPECT_EQ(SampledSource(amplitudes, Matrix::Ones(3, 2)).not_finite(), 6);
  EXPECT_EQ(SampledSource(RowMatrix(amplitudes)).not_finite(), 6);
  amplitudes(6, 1) = 1e200;
  EXPECT_EQ(SampledSource(amplitudes, Matrix::Ones(3, 2)).not_finite(), -1);
  EXPECT_EQ(SampledSource(amplitudes, Matrix::Constant(3, 2, 1e200)).not_finite(), 6);
}

}  // namespace
}  // namespace bromwich
