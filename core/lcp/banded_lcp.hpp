#pragma once
// LCP(q, M), one after another, for a P-matrix M. Its entries and those of its inverses decay away from the diagonal,
// as those of M + W_0 of a diffusion do. The principal pivot transform P(S) of core/lcp/active_set.hpp is therefore
// kept as a band. Entries below eps of the largest are dropped: n of them stay below the rounding bound n eps of a
// product.
//
// symbol  variable  shape
// M       M_        n x (2 b + 1), half-bandwidth b
// P(S)    P_        n x (2 w + 1), half-bandwidth w >= b, widened when an exchange would fill in beyond it
//
// A problem with unchanged active set S costs n (2w + 1) multiplications instead of n |S|; an exchange of one index
// costs 2 (2w + 1)^2 instead of n^2. M and P(S) stay in the caches. Every solution is verified with M itself.

#include "../base/simd.hpp"

#include <memory>
#include <vector>

namespace bromwich::simd {

/// n x n band matrix in blocks of eight rows: entry (i, i + o - w), 0 <= o <= 2w, in lane i % 8.
class Band {
 public:
  Band(Index n, Index w) : w_(w), entries_(std::size_t(blocks(n) * width()), all(0)) {}

  Index half() const { return w_; }
  Index width() const { return 2 * w_ + 1; }
  double at(Index i, Index j) const { return entries_[position(i, j)][i % lanes]; }
  void set(Index i, Index j, double value) { entries_[position(i, j)][i % lanes] = value; }
  const Lanes* row_block(Index b) const { return entries_.data() + b * width(); }
  Lanes* row_block(Index b) { return entries_.data() + b * width(); }
  std::size_t bytes() const { return entries_.size() * sizeof(Lanes); }

  /// Eight entries of the product with x: x points to x_0 and is zero for `half()` entries before it, and for that and
  /// eight more after its end.
  Lanes multiply_block(Index b, const double* x) const;

 private:
  std::size_t position(Index i, Index j) const { return std::size_t((i / lanes) * width() + (j - i + w_)); }

  Index w_;
  std::vector<Lanes> entries_;
};

class BandedLcp {
 public:
  /// Null where bands do not pay: n < 12, n > 128 with M or its inverse wider than n/4, diagonal entries of different
  /// size.
  static std::unique_ptr<BandedLcp> make(const Matrix& M);

  /// y in SOL(q, M), starting from the active set of the last call. false: Newton's method or the verification failed,
  /// y is not changed.
  bool solve(const Vector& q, Vector& y, int& newton);

  /// Start from the active set {y > 0}.
  void start_from(const Vector& y);

  /// M y of the last solution, n entries.
  const double* product() const { return product_.data(); }

  std::size_t bytes() const { return M_.bytes() + P_.bytes(); }

 private:
  BandedLcp(const Matrix& M, Index b, double scale);
  bool widen();
  bool rebuild();
  bool pivot(Index r);
  bool exchange();
  void evaluate();
  void find_flips();
  bool negative(Index i) const;
  bool verified();
  double dropped_fill(Index r) const;
  bool meets_active(Index b, Index w) const;

  Index n_;
  double scale_;       ///< a power of two: scale M has entries of about one
  double row_sum_;     ///< ||scale M||_inf
  Band M_, P_;         ///< of scale M
  bool valid_ = true;  ///< P_ belongs to active_
  int updates_ = 0;    ///< exchanges since P_ was formed from M_
  std::vector<char> active_;
  std::vector<Index> before_;  ///< n + 1: active indices below each
  std::vector<Index> flips_;
  std::vector<double> beyond_;  ///< per block of rows: the largest entry of a column there and farther out
  Vector in_;                   ///< 1 for active indices, 0 for the others, padded to whole blocks
  Vector q_, value_, product_;  ///< padded to whole blocks: scale q, (y_S, scale w_I), M y
  Vector x_, row_, column_;     ///< padded by the half-bandwidth on both sides as well
  double largest_q_ = 0;
};

}  // namespace bromwich::simd
