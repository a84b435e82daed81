#pragma once
// Eight doubles that move together. GCC and Clang lower the vector type to whatever the target has (one AVX-512
// register, two AVX, four SSE2).

#include "core/types.hpp"

#include <cstring>

namespace bromwich::cpu {

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
inline Lanes abs(Lanes a) { return a < 0 ? -a : a; }

inline bool any(LaneMask m) {
  long long sum = 0;
  for (Index i = 0; i < lanes; ++i) sum |= m[i];
  return sum != 0;
}

inline Index blocks(Index n) { return (n + lanes - 1) / lanes; }

}  // namespace bromwich::cpu
