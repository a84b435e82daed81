#pragma once
// The solution of a small complementarity problem on one active set, as a matrix (batch/active_set_table.hpp). It is
// computed in a thread of the host or of a device; nothing is allocated.

#include "../base/types.hpp"

namespace bromwich::scene_steps {

inline constexpr Index most_of_set = 8;                 ///< n
inline constexpr double least_condition_of_set = 1e-7;  ///< reciprocal, of scaled blocks: y keeps nine digits beyond it
inline constexpr double most_of_set_map = 1e3;  ///< entries in scaled units, as those that ActiveSetLcp does not refine

/// a, of `size` rows, becomes its inverse, by elimination with row pivoting. Returns 1 / (|a|_1 |a^{-1}|_1), and 0
/// where a is singular or not finite.
constexpr double invert_block(Index size, double* a) {
  const auto abs = [](double v) { return v < 0 ? -v : v; };
  const auto norm = [&] {
    double largest = 0;
    for (Index j = 0; j < size; ++j) {
      double sum = 0;
      for (Index i = 0; i < size; ++i) sum += abs(a[i * size + j]);
      largest = sum > largest ? sum : largest;
    }
    return largest;
  };
  if (size == 0) return 1;
  const double before = norm();
  Index exchanged[most_of_set] = {};
  for (Index k = 0; k < size; ++k) {
    Index pivot = k;
    for (Index i = k + 1; i < size; ++i)
      if (abs(a[i * size + k]) > abs(a[pivot * size + k])) pivot = i;
    exchanged[k] = pivot;
    if (!(abs(a[pivot * size + k]) > 0)) return 0;
    for (Index j = 0; j < size && pivot != k; ++j) {
      const double kept = a[k * size + j];
      a[k * size + j] = a[pivot * size + j];
      a[pivot * size + j] = kept;
    }
    const double by = 1 / a[k * size + k];
    a[k * size + k] = 1;
    for (Index j = 0; j < size; ++j) a[k * size + j] *= by;
    for (Index i = 0; i < size; ++i) {
      const double factor = a[i * size + k];
      if (i == k) continue;
      a[i * size + k] = 0;
      for (Index j = 0; j < size; ++j) a[i * size + j] -= factor * a[k * size + j];
    }
  }
  for (Index k = size - 1; k >= 0; --k)
    for (Index i = 0; i < size && exchanged[k] != k; ++i) {
      const double kept = a[i * size + k];
      a[i * size + k] = a[i * size + exchanged[k]];
      a[i * size + exchanged[k]] = kept;
    }
  const double condition = 1 / (before * norm());
  return 0 * condition == 0 ? condition : 0;  // false for what is not finite
}

/// V with (y_S, w_I) = V q in scaled units: y_S = -M_SS^{-1} q_S and w_I = q_I - M_IS M_SS^{-1} q_S. `scaled`: M,
/// `rows`: the scaling of q, `V`: n x n. False where M_SS is ill-conditioned.
template <class Table, class Entry>
constexpr bool map_of_set(Index n, unsigned set, const Table& scaled, const Table& rows, const Entry& V) {
  Index active[most_of_set] = {}, size = 0;
  for (Index i = 0; i < n; ++i)
    if (set >> i & 1u) active[size++] = i;
  double inverse[most_of_set * most_of_set] = {};
  for (Index i = 0; i < size; ++i)
    for (Index j = 0; j < size; ++j) inverse[i * size + j] = scaled[active[i] * n + active[j]];
  if (!(invert_block(size, inverse) > least_condition_of_set)) return false;
  double largest = 0;
  for (Index i = 0, place = 0; i < n; ++i) {
    const bool is_active = set >> i & 1u;
    for (Index j = 0; j < n; ++j) V(i * n + j) = !is_active && i == j ? rows[j] : 0;
    for (Index j = 0; j < size; ++j) {
      double sum = 0;
      if (is_active)
        sum = inverse[place * size + j];
      else
        for (Index k = 0; k < size; ++k) sum += scaled[i * n + active[k]] * inverse[k * size + j];
      if (!(0 * sum == 0)) return false;
      largest = sum > largest ? sum : -sum > largest ? -sum : largest;
      V(i * n + active[j]) = -sum * rows[active[j]];
    }
    place += is_active;
  }
  return largest <= most_of_set_map;
}

/// All pivots of M_SS by elimination without exchanges are positive beyond rounding (core/lcp/pivots.hpp).
template <class Table>
constexpr bool set_has_positive_pivots(Index n, unsigned set, const Table& M) {
  double a[most_of_set * most_of_set] = {}, level[most_of_set] = {};
  Index size = 0;
  for (Index i = 0; i < n; ++i) {
    if (!(set >> i & 1u)) continue;
    Index c = 0;
    for (Index j = 0; j < n; ++j)
      if (set >> j & 1u) a[size * most_of_set + c++] = M[i * n + j];
    ++size;
  }
  for (Index i = 0; i < size; ++i) {
    const double d = a[i * most_of_set + i];
    level[i] = 16 * double(size) * epsilon * (d < 0 ? -d : d);
  }
  for (Index k = 0; k < size; ++k) {
    const double pivot = a[k * most_of_set + k];
    if (!(pivot > level[k])) return false;
    for (Index i = k + 1; i < size; ++i)
      for (Index j = k + 1; j < size; ++j)
        a[i * most_of_set + j] -= a[i * most_of_set + k] * a[k * most_of_set + j] / pivot;
  }
  return true;
}

}  // namespace bromwich::scene_steps
