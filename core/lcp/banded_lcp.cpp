#include "core/lcp/banded_lcp.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich::simd {

namespace {

constexpr Index smallest = 12;                ///< below it a dense transform is as fast
constexpr double dropped = epsilon;           ///< entries of M, relative to the largest
constexpr double dropped_in_P = epsilon / 8;  ///< fill-in of P(S), whose entries are about one
constexpr double least_pivot = 1e-3;          ///< of entries of about one: a smaller one would lose digits
constexpr double most_uneven = 64;            ///< between diagonal entries
constexpr int most_updates = 1024;            ///< exchanges before the transform is formed anew
constexpr double verified_to = 256;           ///< eps: about the pivots that act on an entry, each with its rounding
constexpr int most_sweeps = 50;

/// Half-bandwidth beyond which a dense transform takes no longer. Small matrices may be full.
Index widest(Index n) { return n <= 128 ? n - 1 : n / 4; }

Index half_bandwidth(const Matrix& M, double level) {
  const Index n = M.rows();
  Index b = 0;
  for (Index j = 0; j < n; ++j) {
    for (Index i = 0; i < j - b; ++i)
      if (std::abs(M(i, j)) > level) b = j - i;
    for (Index i = n - 1; i > j + b; --i)
      if (std::abs(M(i, j)) > level) b = i - j;
  }
  return b;
}

double largest_of(Lanes a) {
  double largest = 0;
  for (Index i = 0; i < lanes; ++i) largest = std::max(largest, a[i]);
  return largest;
}

}  // namespace

Lanes Band::multiply_block(Index b, const double* x) const {
  const Lanes* D = row_block(b);
  const double* from = x + b * lanes - w_;
  Lanes sum[4] = {all(0), all(0), all(0), all(0)};
  Index o = 0;
  for (; o + 4 <= width(); o += 4)
    for (Index i = 0; i < 4; ++i) sum[i] += D[o + i] * load(from + o + i);
  for (; o < width(); ++o) sum[0] += D[o] * load(from + o);
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

std::unique_ptr<BandedLcp> BandedLcp::make(const Matrix& M) {
  const Index n = M.rows();
  if (n < smallest || !M.allFinite()) return nullptr;
  const double largest = M.diagonal().maxCoeff(), least = M.diagonal().minCoeff();
  if (!(least > 0) || largest > most_uneven * least) return nullptr;
  const double entries = std::max(largest, M.cwiseAbs().maxCoeff());
  const Index b = half_bandwidth(M, dropped * entries);
  if (b > widest(n)) return nullptr;
  std::unique_ptr<BandedLcp> made(new BandedLcp(M, b, std::exp2(-std::ceil(std::log2(entries)))));
  // The inverse of all of M shows how wide the transforms are.
  std::fill(made->active_.begin(), made->active_.end(), 1);
  if (!made->rebuild()) return nullptr;
  std::fill(made->active_.begin(), made->active_.end(), 0);
  return made->rebuild() ? std::move(made) : nullptr;
}

BandedLcp::BandedLcp(const Matrix& M, Index b, double scale)
    : n_(M.rows()),
      scale_(scale),
      row_sum_(scale * M.cwiseAbs().rowwise().sum().maxCoeff()),
      M_(n_, b),
      P_(n_, std::max(b, std::min<Index>(24, widest(n_)))),
      active_(std::size_t(n_), 0),
      before_(std::size_t(n_) + 1, 0),
      beyond_(std::size_t(blocks(n_))) {
  for (Index i = 0; i < n_; ++i)
    for (Index j = std::max<Index>(i - b, 0); j <= std::min(i + b, n_ - 1); ++j) M_.set(i, j, scale * M(i, j));
  flips_.reserve(std::size_t(n_));
  for (Vector* v : {&q_, &value_, &product_, &in_}) *v = Vector::Zero(blocks(n_) * lanes);
  for (Vector* v : {&x_, &row_, &column_}) *v = Vector::Zero(blocks(n_) * lanes + 2 * P_.half() + lanes);
}

// More room for fill-in; false where a band would not pay any more.
bool BandedLcp::widen() {
  if (P_.half() >= widest(n_)) return false;
  const Index w = std::min(P_.half() + P_.half() / 2, widest(n_));
  P_ = Band(n_, w);
  for (Vector* v : {&x_, &row_, &column_}) *v = Vector::Zero(blocks(n_) * lanes + 2 * w + lanes);
  return true;
}

// P(S) from M, one pivot after the other.
bool BandedLcp::rebuild() {
  const Index shift = P_.half() - M_.half();
  for (Index b = 0; b < blocks(n_); ++b) {
    Lanes* to = P_.row_block(b);
    std::fill(to, to + P_.width(), all(0));
    std::copy(M_.row_block(b), M_.row_block(b) + M_.width(), to + shift);
  }
  valid_ = true;
  for (Index i = 0; i < n_ && valid_; ++i)
    if (active_[std::size_t(i)]) valid_ = pivot(i);
  updates_ = 0;
  return valid_ || (widen() && rebuild());
}

// The largest entry that the pivot on r would fill in outside the band: products of an entry of the column and one of
// the row on the other side of the diagonal, farther apart than w.
double BandedLcp::dropped_fill(Index r) const {
  const Index w = P_.half();
  const double *row = row_.data() + w + r, *column = column_.data() + w + r;
  double worst = 0, left = 0, right = 0;
  for (Index o = 1; o <= w; ++o) {
    // Farthest entries first: with column entry o beyond r go the row entries w + 1 - o and more before it.
    const Index far = w + 1 - o;
    left = std::max(left, std::abs(row[-far]));
    right = std::max(right, std::abs(row[far]));
    worst = std::max({worst, std::abs(column[o]) * left, std::abs(column[-o]) * right});
  }
  return worst;
}

// P_rr inverted, column and row r scaled by it, the Schur complement elsewhere. false: P_ is left half-way, because the
// pivot is small or the band too narrow.
bool BandedLcp::pivot(Index r) {
  const double p = P_.at(r, r);
  if (!(p > least_pivot)) return false;
  const Index w = P_.half(), first = std::max<Index>(r - w, 0), last = std::min(r + w, n_ - 1);
  double *row = row_.data() + w, *column = column_.data() + w;
  for (Index k = first; k <= last; ++k) {
    row[k] = P_.at(r, k);
    column[k] = P_.at(k, r) / p;
  }
  row[r] = column[r] = 0;
  const bool fits = dropped_fill(r) <= dropped_in_P;
  // Row entries that still count shrink with the column's, from r outwards: products below `dropped_in_P` are left out.
  for (const Index step : {Index(1), Index(-1)}) {
    const Index nearest = r / lanes + (step < 0 ? -1 : 0), farthest = (step < 0 ? first : last) / lanes;
    double largest = 0;  // of a block and all beyond it: columns need not decay steadily
    for (Index b = farthest; (b - nearest) * step >= 0; b -= step)
      beyond_[std::size_t(b)] = largest = std::max(largest, largest_of(abs(load(column + b * lanes))));
    Index left = w, right = w;
    for (Index b = nearest; (farthest - b) * step >= 0; b += step) {
      const Lanes c = load(column + b * lanes);
      while (left > 0 && std::abs(row[r - left]) * beyond_[std::size_t(b)] <= dropped_in_P) --left;
      while (right > 0 && std::abs(row[r + right]) * beyond_[std::size_t(b)] <= dropped_in_P) --right;
      // j = i + o - w lies in r - left .. r + right for one of the eight rows i.
      const Index from_o = std::max<Index>(r - left - (b * lanes + lanes - 1) + w, 0),
                  to_o = std::min(r + right - b * lanes + w, 2 * w);
      Lanes* D = P_.row_block(b);
      const double* from = row + b * lanes - w;
      for (Index o = from_o; o <= to_o; ++o) D[o] -= c * load(from + o);
    }
  }
  for (Index k = first; k <= last; ++k) {
    P_.set(r, k, -row[k] / p);
    P_.set(k, r, column[k]);
    row[k] = column[k] = 0;
  }
  P_.set(r, r, 1 / p);
  ++updates_;
  return fits;
}

// One of the rows of block b has an active index within the half-bandwidth w.
bool BandedLcp::meets_active(Index b, Index w) const {
  const Index first = std::max<Index>(b * lanes - w, 0), last = std::min((b + 1) * lanes + w, n_);
  return before_[std::size_t(last)] > before_[std::size_t(first)];
}

bool BandedLcp::exchange() {
  for (const Index i : flips_) active_[std::size_t(i)] ^= 1;
  for (Index i = 0; i < n_; ++i) {
    before_[std::size_t(i + 1)] = before_[std::size_t(i)] + active_[std::size_t(i)];
    in_[i] = active_[std::size_t(i)];
  }
  if (updates_ + int(flips_.size()) > most_updates) return rebuild();
  for (const Index i : flips_)
    if (!pivot(i)) return rebuild();
  return true;
}

void BandedLcp::start_from(const Vector& y) {
  flips_.clear();
  for (Index i = 0; i < n_; ++i)
    if ((y[i] > 0) != (active_[std::size_t(i)] != 0)) flips_.push_back(i);
  if (valid_ && !flips_.empty()) valid_ = exchange();
}

// value = (y_S, w_I) = E q - P(:,S) q_S.
void BandedLcp::evaluate() {
  double* x = x_.data() + P_.half();
  for (Index i = 0; i < blocks(n_) * lanes; i += lanes) {
    const Lanes q = load(q_.data() + i), q_S = load(in_.data() + i) * q;
    store(x + i, q_S);
    store(value_.data() + i, q - q_S);
  }
  for (Index b = 0; b < blocks(n_); ++b)
    if (meets_active(b, P_.half()))
      store(value_.data() + b * lanes, load(value_.data() + b * lanes) - P_.multiply_block(b, x));
}

// As ActiveSetLcp has it: beyond the rounding of the largest q and of the terms that the value is summed from.
bool BandedLcp::negative(Index i) const {
  double terms = active_[std::size_t(i)] ? 0 : std::abs(q_[i]);
  for (Index j = std::max<Index>(i - P_.half(), 0); j <= std::min(i + P_.half(), n_ - 1); ++j)
    if (active_[std::size_t(j)]) terms += std::abs(P_.at(i, j) * q_[j]);
  return value_[i] < -16 * epsilon * terms;
}

void BandedLcp::find_flips() {
  flips_.clear();
  const double level = -16 * epsilon * largest_q_;
  LaneMask below{};
  for (Index i = 0; i < blocks(n_) * lanes; i += lanes) below |= load(value_.data() + i) < all(level);
  if (!any(below)) return;
  for (Index i = 0; i < n_; ++i)
    if (value_[i] < level && negative(i)) flips_.push_back(i);
}

// M y + q = w up to the rounding that so many updates may leave.
bool BandedLcp::verified() {
  double* x = x_.data() + P_.half();
  Lanes error = all(0), largest = all(0);
  for (Index i = 0; i < blocks(n_) * lanes; i += lanes) {
    const Lanes in = load(in_.data() + i), value = load(value_.data() + i), y = in * max(value, all(0));
    store(x + i, y);
    store(value_.data() + i, value - in * value);
    largest = max(largest, y);
  }
  for (Index b = 0; b < blocks(n_); ++b) {
    const Lanes product = meets_active(b, M_.half()) ? M_.multiply_block(b, x) : all(0);
    store(product_.data() + b * lanes, product * all(1 / scale_));
    const Lanes apart = abs(product + load(q_.data() + b * lanes) - load(value_.data() + b * lanes));
    if (any(~(apart < all(INFINITY)))) return false;
    error = max(error, apart);
  }
  return largest_of(error) <= verified_to * epsilon * (largest_q_ + row_sum_ * largest_of(largest));
}

bool BandedLcp::solve(const Vector& q, Vector& y, int& newton) {
  if (!std::isfinite(q.cwiseAbs().sum()) || (!valid_ && !rebuild())) return false;
  q_.head(n_) = scale_ * q;
  largest_q_ = q_.cwiseAbs().maxCoeff();
  if (!std::isfinite(largest_q_)) return false;
  for (int sweep = 0; sweep < most_sweeps; ++sweep) {
    ++newton;
    evaluate();
    find_flips();
    if (!flips_.empty()) {
      if (!exchange()) return false;
    } else if (verified()) {
      y = x_.segment(P_.half(), n_);
      return true;
    } else if (updates_ == 0 || !rebuild()) {
      return false;
    }
  }
  return false;
}

}  // namespace bromwich::simd
