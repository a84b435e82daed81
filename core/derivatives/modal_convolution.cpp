#include "core/derivatives/modal_convolution.hpp"

#include "core/base/simd.hpp"
#include "core/kernel/compression.hpp"
#include "core/kernel/recurrence.hpp"
#include "core/numerics/phi.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <utility>

namespace bromwich {

using simd::Lanes;

namespace {

constexpr Index fewest_compressed = 40;  ///< of eigenvalues: a fit of fewer would not halve their number
constexpr Index rows_together = 16;      ///< of time points, which the registers hold
constexpr Index few_rows = 2;            ///< of these, in which most exponentials of a fine line vanish
constexpr double vanished = 1e-290;      ///< as nothing; denormal numbers are slow

// Zeros in further columns.
void fill_up(RowMatrix& table, Index columns) {
  RowMatrix filled = RowMatrix::Zero(table.rows(), columns);
  filled.leftCols(table.cols()) = table;
  table = std::move(filled);
}

// `whole` with these exponentials from lag 2 on. Lags 0 and 1 stay exact.
ModalRecurrence shortened(const ModalRecurrence& whole, const KroneckerDynamics& d, const ExponentialSum& sum,
                          double h) {
  const Vector mu = d.face_eigenvalues();
  const Index n = mu.size(), K = sum.rates.size();
  ModalRecurrence r;
  r.face = whole.face;
  for (RowMatrix* table : {&r.decay, &r.output, &r.start}) table->resize(K, n);
  for (Index k = 0; k < K; ++k) {
    const ArrayPhi phi = array_phi(h * (mu.array() + sum.rates[k]));
    r.decay.row(k) = phi.exponential;
    r.output.row(k) = h * sum.coefficients[k] * phi.phi1.square();
    r.start.row(k) = (phi.phi1 - phi.phi2) / phi.phi1.square();
  }
  const auto lag_1 = [](const ModalRecurrence& of) { return of.output.colwise().sum().transpose(); };
  const auto start_1 = [](const ModalRecurrence& of) {
    return of.output.cwiseProduct(of.start).colwise().sum().transpose();
  };
  r.w0 = whole.w0;
  r.w1 = lag_1(whole) - lag_1(r);
  r.s1 = start_1(whole) - start_1(r);
  return r;
}

}  // namespace

ModalConvolution::ModalConvolution(const KroneckerDynamics& d, double h, double T)
    : r_(modal_recurrence(d, Rule::exponential, h, RowMatrix())) {
  if (d.across.points > fewest_compressed) {
    const ExponentialSum sum = compress_line_kernel(d, h, T);
    if (sum.error <= accepted_compression_error && 2 * sum.rates.size() <= d.across.points)
      r_ = shortened(r_, d, sum, h);
  }
  const Index n = r_.w0.size(), width = simd::blocks(n) * simd::lanes;
  for (RowMatrix* table : {&r_.decay, &r_.output, &r_.start}) fill_up(*table, width);
  for (Vector* weights : {&r_.w1, &r_.s1}) {
    weights->conservativeResize(width);
    weights->tail(width - n).setZero();
  }
}

ModalConvolution::State ModalConvolution::state() const {
  const Index width = r_.decay.cols();
  return {RowMatrix::Zero(r_.decay.rows(), width), Vector::Zero(width), Vector(width)};
}

void ModalConvolution::advance(Index j, const double* u, State& z, Vector& a) const {
  const Index n = a.size(), width = r_.decay.cols(), K = r_.decay.rows();
  std::copy(u, u + n, z.given.data());
  for (Index l = 0; l < width; l += simd::lanes) {
    const Lanes given = simd::load(&z.given[l]);
    Lanes sum = simd::load(j == 1 ? &r_.s1[l] : &r_.w1[l]) * given;
    for (Index k = 0; k < K; ++k) {
      double* at = &z.values(k, l);
      const Lanes value =
          j == 1 ? simd::load(&r_.start(k, l)) * given : simd::load(&r_.decay(k, l)) * simd::load(at) + given;
      sum += simd::load(&r_.output(k, l)) * value;
      simd::store(at, value);
    }
    simd::store(&z.made[l], sum);
  }
  a = z.made.head(n);
}

void ModalConvolution::retreat(Index j, const double* rho, State& zeta, Vector& b) const {
  const Index n = b.size(), width = r_.decay.cols(), K = r_.decay.rows();
  std::copy(rho, rho + n, zeta.given.data());
  for (Index l = 0; l < width; l += simd::lanes) {
    const Lanes given = simd::load(&zeta.given[l]);
    Lanes sum = simd::load(j == 0 ? &r_.s1[l] : &r_.w1[l]) * given;
    for (Index k = 0; k < K; ++k) {
      double* at = &zeta.values(k, l);
      const Lanes value = simd::load(&r_.decay(k, l)) * simd::load(at) + simd::load(&r_.output(k, l)) * given;
      sum += j == 0 ? simd::load(&r_.start(k, l)) * value : value;
      simd::store(at, value);
    }
    simd::store(&zeta.made[l], sum);
  }
  b = zeta.made.head(n);
}

ModalStart::ModalStart(const KroneckerDynamics& d, double h)
    : n_(d.face_points()),
      seen_(d.across.in_modes(d.n)),
      decay_(RowMatrix::Zero(seen_.size(), simd::blocks(n_) * simd::lanes)) {
  const Vector mu = d.face_eigenvalues(), nu = d.across.eigenvalues();
  ends_.resize(seen_.size(), simd::blocks(n_));
  for (Index k = 0; k < nu.size(); ++k) {
    const Eigen::ArrayXd exponents = h * (mu.array() + nu[k]);
    decay_.row(k).head(n_) = exponents.exp();
    for (Index l = 0; l < n_; l += simd::lanes) {
      const double slowest = exponents.segment(l, std::min<Index>(simd::lanes, n_ - l)).maxCoeff();
      ends_(k, l / simd::lanes) = slowest < 0 ? std::log(vanished) / slowest : INFINITY;
    }
  }
}

RowMatrix ModalStart::response(const RowMatrix& x0, Index J) const {
  const Index K = seen_.size(), width = decay_.cols();
  RowMatrix x = RowMatrix::Zero(K, width), out(J + 1, n_), rows(rows_together, width);
  x.leftCols(n_) = seen_.asDiagonal() * x0;
  for (Index first = 0; first <= J; first += rows_together) {
    for (Index l = 0; l < width; l += simd::lanes) {
      Lanes sum[rows_together] = {};
      const auto add = [&]<Index used>(Index k, std::integral_constant<Index, used>) {
        Lanes value = simd::load(&x(k, l));
        const Lanes decay = simd::load(&decay_(k, l));
        for (Index i = 0; i < used; ++i) {
          sum[i] += value;
          value *= decay;
        }
        simd::store(&x(k, l), simd::abs(value) > vanished ? value : Lanes{});
      };
      for (Index k = 0; k < K; ++k) {
        const double left = ends_(k, l / simd::lanes) - double(first);
        if (left >= double(few_rows))
          add(k, std::integral_constant<Index, rows_together>());
        else if (left >= 0)
          add(k, std::integral_constant<Index, few_rows>());
      }
      for (Index i = 0; i < rows_together; ++i) simd::store(&rows(i, l), sum[i]);
    }
    const Index count = std::min(rows_together, J + 1 - first);
    out.middleRows(first, count) = rows.topLeftCorner(count, n_);
  }
  return out;
}

// q_j = E q_{j+1} + rho_j from above the last row, where rows are zero, down to row 0.
RowMatrix ModalStart::transposed(const RowMatrix& rho) const {
  const Index K = seen_.size(), width = decay_.cols();
  RowMatrix q = RowMatrix::Zero(K, width), rows = RowMatrix::Zero(rows_together, width);
  for (Index first = (rho.rows() - 1) / rows_together * rows_together; first >= 0; first -= rows_together) {
    const Index count = std::min(rows_together, rho.rows() - first);
    rows.bottomRows(rows_together - count).setZero();
    rows.topLeftCorner(count, n_) = rho.middleRows(first, count);
    for (Index l = 0; l < width; l += simd::lanes) {
      Lanes given[rows_together];
      for (Index i = 0; i < rows_together; ++i) given[i] = simd::load(&rows(i, l));
      const auto take = [&]<Index used>(Index k, std::integral_constant<Index, used>) {
        Lanes value = simd::load(&q(k, l));
        const Lanes decay = simd::load(&decay_(k, l));
        for (Index i = used; i-- > 0;) value = value * decay + given[i];
        simd::store(&q(k, l), value);
      };
      for (Index k = 0; k < K; ++k) {
        const double left = ends_(k, l / simd::lanes) - double(first);
        if (left >= double(few_rows))
          take(k, std::integral_constant<Index, rows_together>());
        else if (left >= 0)
          take(k, std::integral_constant<Index, few_rows>());
      }
    }
  }
  return seen_.asDiagonal() * q.leftCols(n_);
}

}  // namespace bromwich
