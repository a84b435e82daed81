#pragma once
// The factors of an elimination of eight shifts (core/dynamics/fronts.hpp), and solves with them.
//
// In elimination order zE - A = L U, L with ones on its diagonal. Of the front with pivots P and rest R, for each pivot
// p: 1/u_pp, the column l_ip of the positions i behind p in P and R, and the row u_pi of the same positions, which is
// l_ip u_pp where A and E are symmetric.

#include "fronts.hpp"

namespace bromwich::multifrontal {

class FrontFactors {
 public:
  /// Precondition: the system has no B and no N.
  FrontFactors(const System& system, const Entry& z) : s_(system) {
    std::ptrdiff_t count = 0;
    for (const Front& f : s_.plan.fronts)
      for (Index p = 0; p < f.pivots; ++p) count += size(behind(f, p));
    values_.reserve(std::size_t(count));
    Fronts fronts(s_);
    fronts.keep([this](const auto& front) { take(front); });
    fronts.run(z);
  }

  std::size_t bytes() const { return values_.size() * sizeof(Entry); }

  /// x <- (zE - A)^{-1} x, m entries in elimination order.
  void solve(Entry* x) const {
    forward(x, false);
    backward(x, !s_.symmetric);
  }
  /// The same with the transpose.
  void solve_transposed(Entry* x) const {
    if (s_.symmetric) return solve(x);
    forward(x, true);
    backward(x, false);
  }

 private:
  template <class Eliminated>
  void take(const Eliminated& front) {
    for (Index p = 0; p < front.pivots; ++p) {
      values_.push_back(inverse(front.lower(p, p)));
      for (Index i = p + 1; i < front.main; ++i) values_.push_back(front.lower(i, p));
      for (Index i = p + 1; i < front.main && !s_.symmetric; ++i) values_.push_back(front.upper(p, i));
    }
  }

  static Index behind(const Front& f, Index p) { return f.pivots + Index(f.rest.size()) - p - 1; }
  // The position of row i of a front.
  static std::size_t place(const Front& f, Index i) {
    return std::size_t(i < f.pivots ? f.first + i : Index(f.rest[std::size_t(i - f.pivots)]));
  }

  static bool is_zero(const Entry& e) {
    double sum = 0;
    for (Index lane = 0; lane < simd::lanes; ++lane) sum += std::abs(e.re[lane]) + std::abs(e.im[lane]);
    return sum == 0;
  }

  // x <- L^{-1} x, or U^{-T} x. Right sides of a few constraints are zero in most fronts.
  void forward(Entry* x, bool upper) const {
    const Entry* from = values_.data();
    for (const Front& f : s_.plan.fronts)
      for (Index p = 0; p < f.pivots; ++p) {
        const Index count = behind(f, p);
        const Entry *factors = from + 1 + (upper ? count : 0), inverse_pivot = from[0];
        from += size(count);
        Entry& own = x[f.first + p];
        if (is_zero(own)) continue;
        if (upper) own = product(own, inverse_pivot);
        const Entry value = own;
        for (Index i = 0; i < count; ++i) subtract_product(x[place(f, p + 1 + i)], factors[i], value);
      }
  }

  // x <- U^{-1} x, or with the columns of L: L^{-T} x, and where they stand for U / u_pp, too, U^{-1} x.
  void backward(Entry* x, bool upper) const {
    const Entry* from = values_.data() + values_.size();
    for (std::size_t k = s_.plan.fronts.size(); k-- > 0;) {
      const Front& f = s_.plan.fronts[k];
      for (Index p = f.pivots; p-- > 0;) {
        const Index count = behind(f, p);
        from -= size(count);
        Entry own = x[f.first + p];
        if (s_.symmetric) own = product(own, from[0]);
        const Entry* factors = from + 1 + (upper ? count : 0);
        for (Index i = 0; i < count; ++i) subtract_product(own, factors[i], x[place(f, p + 1 + i)]);
        x[f.first + p] = upper ? product(own, from[0]) : own;
      }
    }
  }

  std::ptrdiff_t size(Index count) const { return 1 + (s_.symmetric ? count : 2 * count); }

  const System& s_;
  std::vector<Entry> values_;
};

}  // namespace bromwich::multifrontal
