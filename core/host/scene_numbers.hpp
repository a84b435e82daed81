#pragma once
// The data of scene_steps.hpp: numbers of one scene or of many at once, rows of time points, sources, matrices, and the
// limits of the checks.

#include "../base/types.hpp"

#include <cstdint>

namespace bromwich::scene_steps {

inline constexpr Index most_states = 32, most_unknowns = 8;  ///< m, n

/// Mask, all(a), max, min, abs, select, and of masks any and no; for double here.
template <class Number>
struct Arithmetic;

template <>
struct Arithmetic<double> {
  using Mask = bool;
  static constexpr double all(double a) { return a; }
  static constexpr double max(double a, double b) { return a > b ? a : b; }
  static constexpr double min(double a, double b) { return a < b ? a : b; }
  static constexpr double abs(double a) { return a < 0 ? -a : a; }
  static constexpr double select(bool mask, double a, double b) { return mask ? a : b; }
  static constexpr bool any(bool mask) { return mask; }
  static constexpr bool no(bool mask) { return !mask; }
};

/// Component i at time point j is base[(j width + i) apart].
template <class Number>
struct Rows {
  Number* base;
  Index width, apart;
  constexpr Number& operator()(Index j, Index i) const { return base[(j * width + i) * apart]; }
};

/// The table of one of many scenes, whose entries lie side by side.
struct Strided {
  const double* base = nullptr;
  Index apart = 1;
  constexpr const double& operator[](Index k) const { return base[k * apart]; }
  constexpr Strided operator+(Index k) const { return {base + k * apart, apart}; }
};

/// What scenes with maps of their own make of samples that all share: scale_i (sample of component i) + (map row i)
/// times the samples that drive it.
template <class Table>
struct SourceMap {
  Table map{};    ///< width x length
  Table scale{};  ///< width, where `scaled`
  const double* samples = nullptr;
  Index length = 0;
  bool scaled = false;
};

/// The same of a source: numbers that all scenes share, own ones, or those of a map of their own.
template <class Number, class Table = const Number*>
struct Source {
  const double* shared;  ///< null: none
  const Number* own;
  Index width, apart;
  SourceMap<Table> by{};
  constexpr Number operator()(Index j, Index i) const {
    if (own) return own[(j * width + i) * apart];
    Number sum = Arithmetic<Number>::all(shared ? shared[j * width + i] : 0);
    if (by.scaled) sum *= by.scale[i];
    for (Index k = 0; k < by.length; ++k) sum += by.map[i * by.length + k] * by.samples[j * by.length + k];
    return sum;
  }
};

/// Matrices row by row, in tables of doubles if the scenes share them, otherwise of Numbers.
template <class Table>
struct Matrices {
  Index m = 0, J = 0;
  double h = 0;
  Table E{}, L{}, R{}, N{}, M{}, B{};
  /// Of the rule by which perturbations grow: its step, E R + L, |E| and |R|.
  Table growth_E{}, growth_G{}, size_of_E{}, size_of_R{};
  const double* part = nullptr;  ///< m: of each state in the first perturbation
  Table y_unit{}, w_unit{};      ///< n: of y and w in the units of the scene
  bool surely_P = false, stages = false;
  double most_growth = 50;
};

// Margins below the limits of core/solve/certification.cpp.
inline constexpr double settled_residual = 1e-10;   ///< of 1e-9
inline constexpr double settled_rounding = 1e-6;    ///< of 1e-4
inline constexpr double settled_impulse = 0.08;     ///< of 0.1
inline constexpr double alternating_part = 0.0099;  ///< of a hundredth (core/kernel/ringing.hpp)
inline constexpr double alternating_run = 16;

/// Numbers in [-1, 1] without a pattern, the same in every run.
struct Noise {
  std::uint64_t state = 20;
  constexpr double operator()() {
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    return double(std::int64_t(state)) * 0x1p-63;
  }
};

}  // namespace bromwich::scene_steps
