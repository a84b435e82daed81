#include "core/dual/sweep_choice.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

using Pair = Eigen::Matrix2cd;

constexpr Index sweep_frequencies = 14, sweep_divisors = 90;
constexpr double lowest_frequency = 0.02;                ///< a step
constexpr double least_divisor = 0.4, most_divisor = 4;  ///< relative to the largest symbol at infinite frequency

// A coupled pair: V on it, and the correction by the coarse grid.
struct Coupled {
  Pair V, correction;
  bool unseen = false;
};

double spectral_radius(const Pair& E) {
  const Complex half = 0.5 * E.trace(), root = std::sqrt(half * half - E.determinant());
  return std::max(std::abs(half + root), std::abs(half - root));
}

double log_frequency(Index i, double highest) {
  return lowest_frequency * std::pow(highest / lowest_frequency, double(i) / double(sweep_frequencies - 1));
}

std::vector<Coupled> euler_pairs(const ModeSymbols& V, double h) {
  std::vector<Coupled> pairs;
  for (Index f = 0; f < sweep_frequencies; ++f) {
    const double omega = log_frequency(f, 0.5 * std::numbers::pi);
    const Complex zeta = std::polar(1.0, -omega);
    const ComplexVector low = V((1.0 - zeta) / h), high = V((1.0 + zeta) / h),
                        coarse = V((1.0 - zeta * zeta) / (2 * h));
    const double kept = 0.5 * (1 + std::cos(omega));
    for (Index l = 0; l < low.size(); ++l) {
      Coupled c;
      c.V = Pair::Zero();
      c.V(0, 0) = low[l];
      c.V(1, 1) = high[l];
      const Eigen::Vector2cd I(kept, 1 - kept);
      const Eigen::RowVector2cd R(low[l] / coarse[l], high[l] / coarse[l]);
      c.correction = Pair::Identity() - I * R;
      pairs.push_back(c);
    }
  }
  return pairs;
}

std::vector<Coupled> stage_pairs(const ModeSymbols& V, double h) {
  std::vector<Coupled> pairs;
  for (Index f = 0; f < sweep_frequencies; ++f) {
    const double omega = log_frequency(f, std::numbers::pi);
    const Complex zeta = std::polar(1.0, -omega);
    const RadauPoints z = radau_points(zeta, h);
    const ComplexVector first = V(z.first), second = V(z.second), coarse = V((1.0 - zeta) / h);
    for (Index l = 0; l < first.size(); ++l) {
      Coupled c;
      c.V = radau_symbol(zeta, h, first[l], second[l]);
      const Eigen::Vector2cd I(0.5 * (1.0 + zeta), 1);
      const Eigen::RowVector2cd R = c.V.row(1) / coarse[l];
      c.correction = Pair::Identity() - I * R;
      pairs.push_back(c);
    }
  }
  return pairs;
}

double contraction_with(const std::vector<Coupled>& pairs, double d, int before, int after, double enough) {
  double worst = 0;
  for (const Coupled& c : pairs) {
    const Pair S = Pair::Identity() - c.V / d;
    Pair E = c.correction;
    for (int i = 0; i < before; ++i) E = (E * S).eval();
    for (int i = 0; i < after; ++i) E = (S * E).eval();
    worst = std::max(worst, spectral_radius(E));
    if (!(worst < enough)) return INFINITY;
  }
  return worst;
}

}  // namespace

RadauPoints radau_points(Complex zeta, double h) {
  const Complex b = 2.0 + zeta, root = std::sqrt(b * b - 6.0 * (1.0 - zeta));
  const Complex plus = b + root, minus = b - root, large = std::abs(plus) > std::abs(minus) ? plus : minus;
  return {6.0 * (1.0 - zeta) / large / h, large / h};
}

// Delta = a^{-1} (I - zeta 1 e_2^T), and f(Delta) by interpolation at its two eigenvalues.
Pair radau_symbol(Complex zeta, double h, Complex at_first, Complex at_second) {
  Pair delta;
  delta << 1.5, 0.5 - 2.0 * zeta, -4.5, 2.5 + 2.0 * zeta;
  const RadauPoints z = radau_points(zeta, h);
  const Complex slope = (at_second - at_first) / (z.second - z.first);
  return at_first * Pair::Identity() + slope * (delta / h - z.first * Pair::Identity());
}

SweepChoice choose_sweep(const ModeSymbols& V, double h, Index stages, int before, int after) {
  const std::vector<Coupled> pairs = stages == 2 ? stage_pairs(V, h) : euler_pairs(V, h);
  const double largest = V(Complex(1 / h)).cwiseAbs().maxCoeff();
  SweepChoice best{largest, INFINITY, 0};
  for (Index i = 0; i <= sweep_divisors; ++i) {
    const double d = largest * least_divisor * std::pow(most_divisor / least_divisor, double(i) / sweep_divisors);
    const double found = contraction_with(pairs, d, before, after, best.contraction);
    if (found < best.contraction) best = {d, found, 0};
  }
  for (const Coupled& c : pairs)
    best.smoothing = std::max(best.smoothing, stages == 2 ? 0 : std::abs(1.0 - c.V(1, 1) / best.shift));
  return best;
}

}  // namespace bromwich
