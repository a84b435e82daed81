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

/// The same of a source: numbers that all scenes share, or own ones.
template <class Number>
struct Source {
  const double* shared;
  const Number* own;
  Index width, apart;
  constexpr Number operator()(Index j, Index i) const {
    return own ? own[(j * width + i) * apart] : Arithmetic<Number>::all(shared[j * width + i]);
  }
};

/// Matrices row by row, of doubles if the scenes share them, otherwise of Numbers.
template <class C>
struct Matrices {
  Index m = 0, J = 0;
  double h = 0;
  const C *E = nullptr, *L = nullptr, *R = nullptr, *N = nullptr, *M = nullptr, *B = nullptr;
  /// Of the rule by which perturbations grow: its step, E R + L, |E| and |R|.
  const C *growth_E = nullptr, *growth_G = nullptr, *size_of_E = nullptr, *size_of_R = nullptr;
  const double* part = nullptr;                  ///< m: of each state in the first perturbation
  const C *y_unit = nullptr, *w_unit = nullptr;  ///< n: of y and w in the units of the scene
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
