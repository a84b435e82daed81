#include "derivatives/modal_start.hpp"

#include "core/base/simd.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace bromwich {

using simd::Lanes;

namespace {

constexpr Index few_rows = 2;           ///< of those together, in which most exponentials of a fine line vanish
constexpr double left_out = 1e-20;      ///< of what other terms have: far below their rounding
constexpr double vanished = 1e-290;     ///< as nothing; denormal numbers are slow
constexpr double weighs_little = 1e-3;  ///< |n^_k| of the largest: too little to compare with

// The slowest eigenvalue that the constraints see.
Index slowest_seen(const Vector& nu, const Vector& seen) {
  const double enough = weighs_little * seen.cwiseAbs().maxCoeff();
  Index slowest = -1;
  for (Index k = 0; k < nu.size(); ++k)
    if (std::abs(seen[k]) >= enough && (slowest < 0 || nu[k] > nu[slowest])) slowest = k;
  return slowest;
}

// Calls take(k, number of rows that count) for the k whose terms in vector `block` of columns are not left out.
template <class Take>
void for_terms(const RowMatrix& ends, Index block, Index first, const Take& take) {
  for (Index k = 0; k < ends.rows(); ++k) {
    const double left = ends(k, block) - double(first);
    if (left >= double(few_rows))
      take(k, std::integral_constant<Index, ModalStart::together>());
    else if (left >= 0)
      take(k, std::integral_constant<Index, few_rows>());
  }
}

}  // namespace

ModalStart::ModalStart(const KroneckerDynamics& d, double h)
    : n_(d.face_points()),
      seen_(d.across.in_modes(d.n)),
      decay_(RowMatrix::Zero(seen_.size(), simd::blocks(n_) * simd::lanes)),
      ends_(RowMatrix::Constant(seen_.size(), simd::blocks(n_), -1)) {
  const Vector mu = d.face_eigenvalues(), nu = d.across.eigenvalues();
  const Index slowest = slowest_seen(nu, seen_);
  const Eigen::ArrayXd compared = (h * (mu.array() + nu[slowest])).min(0);
  for (Index k = 0; k < nu.size(); ++k) {
    const Eigen::ArrayXd exponents = h * (mu.array() + nu[k]);
    decay_.row(k).head(n_) = exponents.exp();
    if (seen_[k] == 0) continue;
    const double smallest = std::log(left_out * std::abs(seen_[slowest] / seen_[k]));
    for (Index l = 0; l < n_; l += simd::lanes) {
      const double rate = (exponents - compared).segment(l, std::min<Index>(simd::lanes, n_ - l)).maxCoeff();
      ends_(k, l / simd::lanes) = rate < 0 ? std::max(0.0, smallest / rate) : INFINITY;
    }
  }
}

RowMatrix ModalStart::terms(const RowMatrix& x0) const {
  RowMatrix terms = nothing();
  terms.leftCols(n_) = seen_.asDiagonal() * x0;
  return terms;
}

void ModalStart::advance(Index first, RowMatrix& terms, Eigen::Ref<RowMatrix> rows) const {
  for (Index l = 0; l < decay_.cols(); l += simd::lanes) {
    Lanes sum[together] = {};
    for_terms(ends_, l / simd::lanes, first, [&]<Index used>(Index k, std::integral_constant<Index, used>) {
      Lanes value = simd::load(&terms(k, l));
      const Lanes decay = simd::load(&decay_(k, l));
      for (Index i = 0; i < used; ++i) {
        sum[i] += value;
        value *= decay;
      }
      simd::store(&terms(k, l), simd::abs(value) > vanished ? value : Lanes{});
    });
    for (Index i = 0; i < std::min(together, rows.rows()); ++i) simd::store(&rows(i, l), sum[i]);
  }
}

void ModalStart::retreat(Index first, const Eigen::Ref<const RowMatrix>& rho, RowMatrix& q) const {
  for (Index l = 0; l < decay_.cols(); l += simd::lanes) {
    Lanes given[together] = {};
    for (Index i = 0; i < std::min(together, rho.rows()); ++i) given[i] = simd::load(rho.row(i).data() + l);
    for_terms(ends_, l / simd::lanes, first, [&]<Index used>(Index k, std::integral_constant<Index, used>) {
      Lanes value = simd::load(&q(k, l));
      const Lanes decay = simd::load(&decay_(k, l));
      for (Index i = used; i-- > 0;) value = value * decay + given[i];
      simd::store(&q(k, l), value);
    });
  }
}

RowMatrix ModalStart::gradient(const RowMatrix& q) const { return seen_.asDiagonal() * q.leftCols(n_); }

RowMatrix ModalStart::response(const RowMatrix& x0, Index J) const {
  RowMatrix at = terms(x0), out(J + 1, n_), rows(together, decay_.cols());
  for (Index first = 0; first <= J; first += together) {
    advance(first, at, rows);
    const Index count = std::min(together, J + 1 - first);
    out.middleRows(first, count) = rows.topLeftCorner(count, n_);
  }
  return out;
}

RowMatrix ModalStart::transposed(const RowMatrix& rho) const {
  RowMatrix q = nothing(), rows = RowMatrix::Zero(together, decay_.cols());
  for (Index first = (rho.rows() - 1) / together * together; first >= 0; first -= together) {
    const Index count = std::min(together, rho.rows() - first);
    rows.topLeftCorner(count, n_) = rho.middleRows(first, count);
    retreat(first, rows.topRows(count), q);
  }
  return gradient(q);
}

}  // namespace bromwich
