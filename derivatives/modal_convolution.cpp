#include "derivatives/modal_convolution.hpp"

#include "core/base/simd.hpp"
#include "core/kernel/compression.hpp"
#include "core/kernel/recurrence.hpp"
#include "core/numerics/phi.hpp"

namespace bromwich {

using simd::Lanes;

namespace {

constexpr Index fewest_compressed = 40;  ///< of eigenvalues: a fit of fewer would not halve their number
constexpr Index moved_together = 4;      ///< time points by which the exponentials move

// Adds C E^i z to sum i.
inline void add_powers(Lanes z, Lanes output, Lanes decay, Lanes (&sums)[moved_together]) {
  Lanes term = output * z;
  for (Lanes& sum : sums) {
    sum += term;
    term *= decay;
  }
}

// A table K x n in the order of ModalConvolution::State::values; zero in further columns.
Vector by_vectors(const RowMatrix& table) {
  const Index K = table.rows(), n = table.cols();
  Vector result = Vector::Zero(K * simd::blocks(n) * simd::lanes);
  for (Index l = 0; l < n; ++l)
    for (Index k = 0; k < K; ++k) result[(l / simd::lanes * K + k) * simd::lanes + l % simd::lanes] = table(k, l);
  return result;
}

Vector filled_up(const Vector& v, Index width) {
  Vector result = Vector::Zero(width);
  result.head(v.size()) = v;
  return result;
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
    r.output.row(k) = h * sum.coefficients(k, 0) * phi.phi1.square();
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

ModalConvolution::ModalConvolution(const KroneckerDynamics& d, double h, double T) {
  ModalRecurrence r = modal_recurrence(d, Rule::exponential, h, RowMatrix());
  if (d.across.points > fewest_compressed) {
    const ExponentialSum sum = compress_line_kernel(d, h, T);
    if (sum.error <= accepted_compression_error && 2 * sum.rates.size() <= d.across.points) r = shortened(r, d, sum, h);
  }
  K_ = r.exponentials();
  own_ = r.w0;
  decay_ = by_vectors(r.decay);
  output_ = by_vectors(r.output);
  start_ = by_vectors(r.start);
  w1_ = filled_up(r.w1, width());
  s1_ = filled_up(r.s1, width());
  lags_ = RowMatrix::Zero(moved_together - 1, width());
  RowMatrix terms = r.output;  // C E^{lag-1}
  for (Index lag = 1; lag < moved_together; ++lag) {
    lags_.row(lag - 1).head(r.modes()) = terms.colwise().sum();
    if (lag == 1) lags_.row(0) += w1_.transpose();
    terms = terms.cwiseProduct(r.decay);
  }
}

ModalConvolution::State ModalConvolution::state() const {
  return {Vector::Zero(decay_.size()), RowMatrix::Zero(moved_together - 1, width()),
          RowMatrix::Zero(moved_together, width())};
}

void ModalConvolution::start(const double* u, State& z, double* a) const {
  for (Index l = 0, at = 0; l < width(); l += simd::lanes) {
    const Lanes given = simd::load(u + l);
    Lanes sums[moved_together] = {};
    for (Index k = 0; k < K_; ++k, at += simd::lanes) {
      const Lanes value = simd::load(&start_[at]) * given;
      simd::store(&z.values[at], value);
      add_powers(value, simd::load(&output_[at]), simd::load(&decay_[at]), sums);
    }
    for (Index i = 0; i < moved_together; ++i) simd::store(&z.older(i, l), sums[i]);
    simd::store(a + l, simd::load(&s1_[l]) * given + sums[0]);
  }
  z.waiting = 0;
}

void ModalConvolution::advance(const double* u, State& z, double* a) const {
  const Index behind = z.waiting;
  if (behind + 1 < moved_together) {  // by lags
    for (Index l = 0; l < width(); l += simd::lanes) {
      const Lanes given = simd::load(u + l);
      simd::store(&z.later(behind, l), given);
      Lanes sum = simd::load(&z.older(behind + 1, l)) + simd::load(&lags_(0, l)) * given;
      for (Index i = 0; i < behind; ++i) sum += simd::load(&lags_(behind - i, l)) * simd::load(&z.later(i, l));
      simd::store(a + l, sum);
    }
    ++z.waiting;
    return;
  }
  for (Index l = 0, at = 0; l < width(); l += simd::lanes) {
    Lanes given[moved_together], sums[moved_together] = {};
    for (Index i = 0; i < behind; ++i) given[i] = simd::load(&z.later(i, l));
    given[behind] = simd::load(u + l);
    for (Index k = 0; k < K_; ++k, at += simd::lanes) {
      const Lanes decay = simd::load(&decay_[at]);
      Lanes value = simd::load(&z.values[at]);
      for (const Lanes& next : given) value = value * decay + next;
      simd::store(&z.values[at], value);
      add_powers(value, simd::load(&output_[at]), decay, sums);
    }
    for (Index i = 0; i < moved_together; ++i) simd::store(&z.older(i, l), sums[i]);
    simd::store(a + l, simd::load(&w1_[l]) * given[behind] + sums[0]);
  }
  z.waiting = 0;
}

void ModalConvolution::finish(const double* rho, const State& zeta, double* b) const {
  for (Index l = 0, at = 0; l < width(); l += simd::lanes) {
    const Lanes given = simd::load(rho + l);
    Lanes sum = simd::load(&s1_[l]) * given;
    for (Index k = 0; k < K_; ++k, at += simd::lanes) {
      const Lanes decay = simd::load(&decay_[at]);
      Lanes value = simd::load(&zeta.values[at]);
      for (Index i = 0; i < zeta.waiting; ++i) value = value * decay + simd::load(&zeta.later(i, l));
      sum += simd::load(&output_[at]) * simd::load(&start_[at]) * (value * decay + given);
    }
    simd::store(b + l, sum);
  }
}

}  // namespace bromwich
