#pragma once
// Complementarity problems of eight scenes in the lanes of a vector, each by the stored inverse on the active set that
// its lane has now (batch/active_set_table.hpp). A lane whose set is wrong leaves the others for that problem.

#include "../core/base/simd.hpp"
#include "../core/host/scene_steps.hpp"
#include "active_set_table.hpp"

#include <array>

namespace bromwich {

namespace scene_steps {

template <>
struct Arithmetic<simd::Lanes> {
  using Lanes = simd::Lanes;
  using Mask = simd::LaneMask;
  static Lanes all(double a) { return simd::all(a); }
  static Lanes max(Lanes a, Lanes b) { return a > b ? a : b; }
  static Lanes min(Lanes a, Lanes b) { return a < b ? a : b; }
  static Lanes abs(Lanes a) { return simd::abs(a); }
  static Lanes select(Mask mask, Lanes a, Lanes b) { return mask ? a : b; }
  static bool any(Mask mask) { return simd::any(mask); }
  static Mask no(Mask mask) { return ~mask; }
};

}  // namespace scene_steps

class LaneProblem {
  using Lanes = simd::Lanes;
  using LaneMask = simd::LaneMask;
  using A = scene_steps::Arithmetic<Lanes>;

 public:
  using Tables = std::array<const ActiveSetTable*, simd::lanes>;

  /// One table for each lane; they keep their sets. Lanes whose set the new table cannot use are lost.
  void use(const Tables& tables, LaneMask& lost) {
    if (tables == tables_) return;
    tables_ = tables;
    for (Index l = 0; l < simd::lanes; ++l) {
      for (Index i = 0; i < tables[std::size_t(l)]->size(); ++i) {
        row_scale_[i][l] = tables[std::size_t(l)]->row_scale(i);
        column_scale_[i][l] = tables[std::size_t(l)]->column_scale(i);
      }
      if (!load(l)) lost[l] = -1;
    }
  }
  void start_from(Index lane, unsigned set) { set_[lane] = set; }
  unsigned set(Index lane) const { return set_[lane]; }

  template <Index size>
  void solve(const Lanes* q, Lanes* y, LaneMask& lost) {
    Lanes value[size], least = simd::all(0), largest = simd::all(0);
    values<size>(q, value, least, largest);
    const LaneMask wrong = (least < largest * (-16 * epsilon)) & ~lost;
    if (simd::any(wrong))
      for (Index l = 0; l < simd::lanes; ++l)
        if (wrong[l] && !exchange<size>(q, l, value)) lost[l] = -1;
    for (Index i = 0; i < size; ++i)
      y[i] = Lanes(LaneMask(A::max(value[i] * column_scale_[i], simd::all(0))) & active_[i]);
  }

  /// Solutions that are certainly the only ones; the lanes without are `uncertain`. For problems that are not of class
  /// P: no y_i and w_i are both near rounding, as is_certainly_unique (core/lcp/solution.hpp) demands.
  template <Index size>
  void try_stages(const Lanes* q, Lanes* y, LaneMask& uncertain) {
    Lanes value[size], least = simd::all(INFINITY), largest = simd::all(0);
    values<size>(q, value, least, largest);
    LaneMask doubtful = uncertain_of<size>(value, least, largest);
    if (simd::any(doubtful)) {
      for (Index l = 0; l < simd::lanes; ++l)
        if (doubtful[l]) exchange<size>(q, l, value);
      least = simd::all(INFINITY);
      for (Index i = 0; i < size; ++i) least = A::min(least, value[i]);
      doubtful = uncertain_of<size>(value, least, largest);
    }
    uncertain |= doubtful;
    for (Index i = 0; i < size; ++i)
      y[i] = Lanes(LaneMask(A::max(value[i] * column_scale_[i], simd::all(0))) & active_[i]);
  }

  /// The active sets {y_i > 0}.
  template <Index size>
  void take(const Lanes* y, LaneMask& lost) {
    for (Index l = 0; l < simd::lanes; ++l) {
      unsigned set = 0;
      for (Index i = 0; i < size; ++i) set |= y[i][l] > 0 ? 1u << i : 0u;
      if (set == set_[l]) continue;
      set_[l] = set;
      if (!lost[l] && !load(l)) lost[l] = -1;
    }
  }

  /// u = V v on the active sets.
  template <Index size>
  void respond(const Lanes* v, Lanes* u) const {
    for (Index i = 0; i < size; ++i) u[i] = Lanes(LaneMask(column_scale_[i] * row_times<size>(v, i)) & active_[i]);
  }

  /// The sets that `take` has taken have lasted for `run` steps.
  void lasts(Lanes run, LaneMask& lost) const { lost |= run > limit_; }
  std::function<double(Index lane, unsigned set)> longest;  ///< empty: no limits

  bool certain = false;  ///< class P: solutions are the only ones

 private:
  template <Index size>
  Lanes row_times(const Lanes* q, Index i) const {
    Lanes sum = V_[i * size] * q[0];
    for (Index k = 1; k < size; ++k) sum += V_[i * size + k] * q[k];
    return sum;
  }

  template <Index size>
  void values(const Lanes* q, Lanes* value, Lanes& least, Lanes& largest) const {
    for (Index i = 0; i < size; ++i) {
      value[i] = row_times<size>(q, i);
      least = A::min(least, value[i]);
      largest = A::max(largest, A::abs(q[i]) * row_scale_[i]);
    }
  }

  // y_i > 0 has to exceed 1e-10 of the terms of a row in which its scaled entry is at least 1/2, w_i that part of its
  // own terms; all terms together are below largest + 2 size most.
  template <Index size>
  LaneMask uncertain_of(const Lanes* value, Lanes least, Lanes largest) const {
    if (certain) return ~(least >= largest * (-16 * epsilon));
    Lanes most = simd::all(0);
    for (Index i = 0; i < size; ++i) most = A::max(most, A::abs(value[i]));
    return ~(least > 2e-10 * (largest + double(2 * size) * most));
  }

  // Another active set, by semismooth Newton.
  template <Index size>
  bool exchange(const Lanes* q, Index lane, Lanes* value) {
    double given[size], found[size];
    for (Index i = 0; i < size; ++i) given[i] = q[i][lane];
    unsigned set = set_[lane];
    if (!tables_[std::size_t(lane)]->solve(given, set, found)) return false;
    if (set != set_[lane]) {
      set_[lane] = set;
      load(lane);
    }
    for (Index i = 0; i < size; ++i) value[i][lane] = found[i];
    return true;
  }

  bool load(Index lane) {
    const ActiveSetTable& table = *tables_[std::size_t(lane)];
    const Index n = table.size();
    const ActiveSetTable::Entry& entry = table.at(set_[lane]);
    for (Index k = 0; k < n * n; ++k) V_[k][lane] = entry.usable ? entry.V[std::size_t(k)] : 0;
    for (Index i = 0; i < n; ++i) active_[i][lane] = (set_[lane] >> i) & 1u ? -1 : 0;
    limit_[lane] = longest ? longest(lane, set_[lane]) : INFINITY;
    return entry.usable;
  }

  Tables tables_ = {};
  Lanes V_[largest_tabulated * largest_tabulated] = {}, row_scale_[largest_tabulated] = {},
                               column_scale_[largest_tabulated] = {}, limit_ = {};
  LaneMask active_[largest_tabulated] = {};
  unsigned set_[simd::lanes] = {};
};

}  // namespace bromwich
