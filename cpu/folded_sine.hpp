#pragma once
// The sine matrix of n points as two matrices of half the size (cpu/transform.cpp).

#include "core/base/types.hpp"

#include <cmath>

namespace bromwich::cpu {

// The even half holds the odd wave numbers 1, 3, ...; the odd half holds the even ones.
struct FoldedSine {
  explicit FoldedSine(Index n) : n(n), even((n + 1) / 2), odd(n / 2), E(even, even), O(odd, odd) {
    // One period of the sine as a table; i k is reduced exactly.
    Vector period(2 * (n + 1));
    for (Index a = 0; a < period.size(); ++a)
      period[a] = std::sqrt(2.0 / double(n + 1)) * std::sin(M_PI * double(a) / double(n + 1));
    const auto s = [&](Index i, Index k) { return period[i * k % period.size()]; };
    for (Index i = 0; i < even; ++i)
      for (Index q = 0; q < even; ++q) E(i, q) = s(i + 1, 2 * q + 1);
    for (Index i = 0; i < odd; ++i)
      for (Index q = 0; q < odd; ++q) O(i, q) = s(i + 1, 2 * q + 2);
  }

  void fold(const double* in, double* e, double* o) const {
    for (Index i = 0; i < odd; ++i) {
      const double a = in[i], b = in[n - 1 - i];
      e[i] = a + b;
      o[i] = a - b;
    }
    if (even > odd) e[odd] = in[odd];
  }

  Index n, even, odd;
  RowMatrix E, O;
};

}  // namespace bromwich::cpu
