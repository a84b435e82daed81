#include "core/dual/sweep_choice.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

using Pair = Eigen::Matrix2cd;

constexpr Index sweep_frequencies = 14, sweep_divisors = 60, stage_factors = 16;
constexpr double lowest_frequency = 0.02;                ///< a step
constexpr double least_divisor = 0.4, most_divisor = 4;  ///< relative to the largest symbol at infinite frequency

// A coupled pair: V on it, and the correction by the coarse grid.
struct Coupled {
  Pair V, correction;
  bool unseen = false;
};

// ||E^2||^{1/2}: cycles begin before the spectral radius shows, and the norm of one cycle has what injection adds once.
double factor_of_two_cycles(const Pair& E) {
  const Pair twice = E * E;
  const double squares = twice.squaredNorm(),
               determinant = std::abs(twice(0, 0) * twice(1, 1) - twice(0, 1) * twice(1, 0));
  const double root = std::sqrt(std::max(squares * squares - 4 * determinant * determinant, 0.0));
  return std::pow(0.5 * (squares + root), 0.25);
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
    const RadauPoints z = radau_frequencies(zeta, h);
    const ComplexVector first = V(z.first), second = V(z.second), coarse = V((1.0 - zeta) / h);
    for (Index l = 0; l < first.size(); ++l) {
      Coupled c;
      c.V = radau_symbol(zeta, h, first[l], second[l]);
      const Eigen::Vector2cd I(0.5 * (1.0 + zeta), 1);
      const Eigen::RowVector2cd R = (0.75 * c.V.row(0) + 0.25 * c.V.row(1)) / coarse[l];
      c.correction = Pair::Identity() - I * R;
      pairs.push_back(c);
    }
  }
  return pairs;
}

// d_i/d: the Chebyshev nodes for values between `lowest` and `highest`, the largest first.
std::vector<double> relative_divisors(int before, double lowest, double highest) {
  const double r = lowest > 0 && highest < INFINITY ? (highest - lowest) / (highest + lowest) : 0;
  std::vector<double> nodes;
  for (int i = 0; i < before; ++i) nodes.push_back(1 + r * std::cos((i + 0.5) * std::numbers::pi / before));
  return nodes;
}

// `over` is d^{-1}.
double contraction_of(const Coupled& c, const Pair& over, const std::vector<double>& before, int after) {
  const Pair step = over * c.V, S = Pair::Identity() - step;
  Pair E = c.correction;
  for (const double node : before) E = (E * (Pair::Identity() - step / node)).eval();
  for (int i = 0; i < after; ++i) E = (S * E).eval();
  return factor_of_two_cycles(E);
}

// The largest of all pairs; infinite from `enough` on. `hardest` is looked at first, and becomes the one that refuses:
// most divisors are refused by one pair.
double contraction_with(const std::vector<Coupled>& pairs, const Pair& over, const std::vector<double>& before,
                        int after, double enough, std::size_t& hardest) {
  double worst = 0;
  for (std::size_t i = 0; i <= pairs.size(); ++i) {
    const std::size_t at = i == 0 ? hardest : i - 1;
    const double found = contraction_of(pairs[at], over, before, after);
    if (!(found < enough)) {
      hardest = at;
      return INFINITY;
    }
    worst = std::max(worst, found);
  }
  return worst;
}

// 0 .. count - 1 in ever smaller strides, so that the best one so far soon refuses the others.
std::vector<Index> spread_order(Index count) {
  std::vector<Index> order{0};
  Index stride = 1;
  while (2 * stride < count) stride *= 2;
  for (; stride > 0; stride /= 2)
    for (Index i = stride; i < count; i += 2 * stride) order.push_back(i);
  return order;
}

SweepChoice choose_divisor(const ModeSymbols& V, double h, int before, int after, bool vary) {
  const std::vector<Coupled> pairs = euler_pairs(V, h);
  const Vector within = V(Complex(1 / h)).cwiseAbs();
  const double largest = within.maxCoeff();
  const std::vector<double> nodes = relative_divisors(before, vary ? within.minCoeff() : largest, largest);
  SweepChoice best;
  best.shift = largest;
  best.contraction = INFINITY;
  std::size_t hardest = 0;
  for (const Index i : spread_order(sweep_divisors + 1)) {
    const double d = largest * least_divisor * std::pow(most_divisor / least_divisor, double(i) / sweep_divisors);
    const double found = contraction_with(pairs, Pair::Identity() / d, nodes, after, best.contraction, hardest);
    if (found < best.contraction) best.shift = d, best.contraction = found;
  }
  for (const double node : nodes) best.shifts.push_back(best.shift * node);
  best.shifts.push_back(best.shift);
  for (const Coupled& c : pairs) best.smoothing = std::max(best.smoothing, std::abs(1.0 - c.V(1, 1) / best.shift));
  return best;
}

// The smallest and the largest eigenvalue of d^{-1} V_0 in modulus, over all modes.
std::pair<double, double> range_within_steps(const std::vector<Eigen::Matrix2d>& blocks, const Eigen::Matrix2d& over) {
  double lowest = INFINITY, highest = 0;
  for (const Eigen::Matrix2d& block : blocks) {
    const Eigen::Matrix2d relative = over * block;
    const double half = 0.5 * relative.trace();
    const Complex root = std::sqrt(Complex(half * half - relative.determinant()));
    lowest = std::min({lowest, std::abs(half - root), std::abs(half + root)});
    highest = std::max({highest, std::abs(half - root), std::abs(half + root)});
  }
  return {lowest, highest};
}

// The lower part of V_0 of modes between the lowest and the highest, times a factor.
SweepChoice choose_stage_divisors(const ModeSymbols& V, double h, int before, int after, bool vary) {
  const std::vector<Coupled> pairs = stage_pairs(V, h);
  const RadauPoints z = radau_frequencies(0, h);
  const ComplexVector first = V(z.first), second = V(z.second);
  std::vector<Eigen::Matrix2d> blocks;
  for (Index l = 0; l < first.size(); ++l) blocks.push_back(radau_symbol(0, h, first[l], second[l]).real());
  const auto by_first = [](const auto& a, const auto& b) { return a(0, 0) < b(0, 0); };
  const auto [low, high] = std::minmax_element(blocks.begin(), blocks.end(), by_first);
  SweepChoice best;
  best.contraction = INFINITY;
  Eigen::Matrix2d chosen = *high;
  std::vector<double> chosen_nodes(std::size_t(before), 1);
  std::size_t hardest = 0;
  for (Index part = 0; part <= 4; ++part) {
    const Eigen::Matrix2d block = (1 - 0.25 * double(part)) * *low + 0.25 * double(part) * *high;
    Eigen::Matrix2d inverse;
    inverse << 1 / block(0, 0), 0, -block(1, 0) / (block(0, 0) * block(1, 1)), 1 / block(1, 1);
    const auto [lowest, highest] = range_within_steps(blocks, inverse);
    const std::vector<double> nodes = relative_divisors(before, vary ? lowest : highest, highest);
    for (const Index i : spread_order(stage_factors + 1)) {
      const double factor = 0.5 * std::pow(5.0, double(i) / double(stage_factors));
      const double found =
          contraction_with(pairs, inverse.cast<Complex>() / factor, nodes, after, best.contraction, hardest);
      if (!(found < best.contraction)) continue;
      best.contraction = found;
      chosen = factor * block;
      chosen_nodes = nodes;
    }
  }
  best.shift = chosen(1, 1);
  chosen_nodes.push_back(1);
  for (const double node : chosen_nodes)
    best.stages.push_back({node * chosen(0, 0), node * chosen(1, 0), node * chosen(1, 1)});
  return best;
}

}  // namespace

RadauPoints radau_frequencies(Complex zeta, double h) {
  const Complex b = 2.0 + zeta, root = std::sqrt(b * b - 6.0 * (1.0 - zeta));
  const Complex plus = b + root, minus = b - root, large = std::abs(plus) > std::abs(minus) ? plus : minus;
  return {6.0 * (1.0 - zeta) / large / h, large / h};
}

// Delta = a^{-1} (I - zeta 1 e_2^T), and f(Delta) by interpolation at its two eigenvalues.
Pair radau_symbol(Complex zeta, double h, Complex at_first, Complex at_second) {
  Pair delta;
  delta << 1.5, 0.5 - 2.0 * zeta, -4.5, 2.5 + 2.0 * zeta;
  const RadauPoints z = radau_frequencies(zeta, h);
  const Complex slope = (at_second - at_first) / (z.second - z.first);
  return at_first * Pair::Identity() + slope * (delta / h - z.first * Pair::Identity());
}

SweepChoice choose_sweep(const ModeSymbols& V, double h, Index stages, int before, int after, bool vary) {
  return stages == 2 ? choose_stage_divisors(V, h, before, after, vary) : choose_divisor(V, h, before, after, vary);
}

}  // namespace bromwich
