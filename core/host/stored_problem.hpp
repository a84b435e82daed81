#pragma once
// The small complementarity problem of one scene, solved by its stored maps on active sets, as ActiveSetTable
// (batch/) does in the lanes of the host. It runs in a thread of the host or of a device.

#include "../base/types.hpp"

#include <cmath>

namespace bromwich::scene_steps {

/// StoredSets (core/seam/scene_march.hpp) where they are used, in tables that scenes share or each has.
template <class Table = const double*>
struct Sets {
  Table V{}, rows{}, columns{};
  bool all_solutions = true;
};

/// Steps that active sets have lasted at most, of one of many scenes.
struct LongestRuns {
  int* base = nullptr;  ///< null: they are not kept
  Index apart = 1;
  constexpr void take(unsigned set, double run) const {
    int& longest = base[Index(set) * apart];
    longest = int(run) > longest ? int(run) : longest;
  }
};

/// The problem of a scene, which keeps its active set from step to step.
template <class Table = const double*>
struct StoredProblem {
  Sets<Table> sets;
  const double* longest = nullptr;  ///< null: no limits
  unsigned set = 0;
  LongestRuns runs{};

  template <Index u>
  constexpr double row_times(const double* q, Index i) const {
    const Table v = sets.V + (Index(set) * u + i) * u;
    double sum = 0;
    for (Index k = 0; k < u; ++k) sum += v[k] * q[k];
    return sum;
  }
  template <Index u>
  constexpr bool usable() const {
    return sets.V[Index(set) * u * u] == sets.V[Index(set) * u * u];
  }
  constexpr bool active(Index i) const { return set >> i & 1u; }

  /// Semismooth Newton, as ActiveSetTable::solve. A cycle uses up its sweeps.
  template <Index u>
  constexpr bool newton(const double* q, double largest, double* value) {
    for (int sweep = 0; sweep < 12 + int(u); ++sweep) {
      if (!usable<u>()) return false;
      unsigned flips = 0;
      const Table v = sets.V + Index(set) * u * u;
      for (Index i = 0; i < u; ++i) {
        double sum = 0, terms = 0;
        for (Index k = 0; k < u; ++k) {
          const double term = v[i * u + k] * q[k];
          sum += term;
          terms += term < 0 ? -term : term;
        }
        value[i] = sum;
        if (sum < -16 * epsilon * largest && sum < -16 * epsilon * terms) flips |= 1u << i;
      }
      if (flips == 0) return true;
      set ^= flips;
    }
    return false;
  }

  template <Index u>
  constexpr void take_value(const double* value, double* y) const {
    for (Index i = 0; i < u; ++i) {
      const double own = value[i] * sets.columns[i];
      y[i] = active(i) && own > 0 ? own : 0;
    }
  }

  template <Index u>
  constexpr double largest_of(const double* q) const {
    double largest = 0;
    for (Index i = 0; i < u; ++i) {
      const double size = (q[i] < 0 ? -q[i] : q[i]) * sets.rows[i];
      largest = size > largest ? size : largest;
    }
    return largest;
  }

  template <Index u>
  constexpr void solve(const double* q, double* y, bool& lost) {
    double value[u] = {};
    const double largest = largest_of<u>(q);
    if (!lost && !newton<u>(q, largest, value)) lost = true;
    take_value<u>(value, y);
  }

  template <Index u>
  constexpr void try_stages(const double* q, double* y, bool& uncertain) {
    double value[u] = {};
    const double largest = largest_of<u>(q);
    bool certain = newton<u>(q, largest, value);
    double least = INFINITY, most = 0;
    for (Index i = 0; i < u; ++i) {
      const double size = value[i] < 0 ? -value[i] : value[i];
      least = value[i] < least ? value[i] : least;
      most = size > most ? size : most;
    }
    certain = certain && (sets.all_solutions || least > 2e-10 * (largest + double(2 * u) * most));
    uncertain = uncertain || !certain;
    take_value<u>(value, y);
  }

  template <Index u>
  constexpr void take(const double* y, bool& lost) {
    set = 0;
    for (Index i = 0; i < u; ++i) set |= y[i] > 0 ? 1u << i : 0u;
    if (!usable<u>()) lost = true;
  }

  template <Index u>
  constexpr void respond(const double* v, double* to) const {
    for (Index i = 0; i < u; ++i) to[i] = active(i) ? sets.columns[i] * row_times<u>(v, i) : 0;
  }

  /// mu = -V^T eta on the set: mu_S = M_SS^{-T} eta_S.
  template <Index u>
  constexpr void respond_transposed(const double* eta, double* mu) const {
    for (Index i = 0; i < u; ++i) mu[i] = 0;
    for (Index k = 0; k < u; ++k) {
      if (!active(k)) continue;
      const Table v = sets.V + (Index(set) * u + k) * u;
      const double weight = sets.columns[k] * eta[k];
      for (Index i = 0; i < u; ++i)
        if (active(i)) mu[i] -= v[i] * weight;
    }
  }

  /// The set has lasted for `run` steps.
  constexpr void lasts(double run, bool& lost) const {
    if (longest && run > longest[set]) lost = true;
    if (runs.base) runs.take(set, run);
  }
};

}  // namespace bromwich::scene_steps
