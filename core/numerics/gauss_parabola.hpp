#pragma once
// The parabola through values at the three Gauss points of [0, 1].

#include <array>

namespace bromwich {

inline constexpr std::array<double, 3> gauss_points{0.1127016653792583, 0.5, 0.8872983346207417};

/// c_0, c_1, c_2 of c_0 + c_1 σ + c_2 σ² from the values there, numbers or vectors: divided differences, then powers.
template <class Value>
std::array<Value, 3> gauss_parabola(const std::array<Value, 3>& v) {
  const auto& p = gauss_points;
  const Value d01 = (v[1] - v[0]) / (p[1] - p[0]), d12 = (v[2] - v[1]) / (p[2] - p[1]),
              bend = (d12 - d01) / (p[2] - p[0]);
  return {Value(v[0] - p[0] * d01 + p[0] * p[1] * bend), Value(d01 - (p[0] + p[1]) * bend), bend};
}

}  // namespace bromwich
