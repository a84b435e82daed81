#pragma once
// Vectors of eight doubles. GCC and Clang lower the type to the registers of the target (one AVX-512, two AVX, four
// SSE2).

#include "core/base/types.hpp"

#include <cstring>

namespace bromwich::simd {

inline constexpr Index lanes = 8;

typedef double Lanes __attribute__((vector_size(64)));
typedef long long LaneMask __attribute__((vector_size(64)));  // 0 or -1 per lane, as comparisons give

inline Lanes all(double a) { return Lanes{a, a, a, a, a, a, a, a}; }

inline Lanes load(const double* from) {
  Lanes v;
  std::memcpy(&v, from, sizeof v);
  return v;
}

inline void store(double* to, Lanes v) { std::memcpy(to, &v, sizeof v); }

inline Lanes max(Lanes a, Lanes b) { return a > b ? a : b; }
inline Lanes min(Lanes a, Lanes b) { return a < b ? a : b; }
inline Lanes abs(Lanes a) { return Lanes(LaneMask(a) & ~(1ll << 63)); }  // clears the sign bit

inline bool any(LaneMask m) {
  long long sum = 0;
  for (Index i = 0; i < lanes; ++i) sum |= m[i];
  return sum != 0;
}

/// Transposes an 8 x 8 block: off-diagonal blocks of width 1, 2 and 4 are swapped in turn.
inline void transpose(Lanes m[lanes]) {
  for (Index r = 0; r < lanes; r += 2) {
    const Lanes a = m[r], b = m[r + 1];
    m[r] = __builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14);
    m[r + 1] = __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15);
  }
  for (const Index r : {0, 1, 4, 5}) {
    const Lanes a = m[r], b = m[r + 2];
    m[r] = __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13);
    m[r + 2] = __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15);
  }
  for (Index r = 0; r < lanes / 2; ++r) {
    const Lanes a = m[r], b = m[r + 4];
    m[r] = __builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11);
    m[r + 4] = __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15);
  }
}

inline Index blocks(Index n) { return (n + lanes - 1) / lanes; }

}  // namespace bromwich::simd
