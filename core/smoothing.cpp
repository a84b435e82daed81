#include "core/smoothing.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

constexpr Index frequencies = 24, most_modes = 48;  ///< of the sample; the symbols are smooth in both
constexpr Index candidates = 120;
constexpr double least_diagonal = 0.05;  ///< M + D I keeps this part of the smallest eigenvalue of M

// The eigenvalues 0 < M^_l of tridiag(b, a, b), b <= 0, in the order of the sine modes.
std::optional<Vector> eigenvalues(const LcpMatrix& matrix) {
  const auto* M = std::get_if<Tridiagonal>(&matrix);
  if (!M) return std::nullopt;
  const Index n = M->diagonal.size();
  const double a = M->diagonal[0], b = n > 1 ? M->upper[0] : 0;
  for (Index i = 0; i < n; ++i)
    if (M->diagonal[i] != a || (i > 0 && M->lower[i] != b) || (i + 1 < n && M->upper[i] != b)) return std::nullopt;
  Vector values(n);
  for (Index l = 0; l < n; ++l) values[l] = a + 2 * b * std::cos(std::numbers::pi * double(l + 1) / double(n + 1));
  if (b > 0 || !(values.minCoeff() > 0)) return std::nullopt;
  return values;
}

// K^_l(omega) from the recurrence: w0 + w1 e^{-i omega} + Σ_k C_k / (e^{i omega} - E_k).
Complex symbol(const ModalRecurrence& r, Index l, double omega) {
  const double c = std::cos(omega), s = std::sin(omega);
  double real = r.w0[l] + r.w1[l] * c, imaginary = -r.w1[l] * s;
  for (Index k = 0; k < r.exponentials(); ++k) {
    const double E = r.decay(k, l), weight = r.output(k, l) / ((c - E) * (c - E) + s * s);
    real += weight * (c - E);
    imaginary -= weight * s;
  }
  return {real, imaginary};
}

// Σ_{d<=steps} W_d. A fit of exponentials holds up to there and no longer: its slowest ones may stand for nothing.
double sum_of_weights(const ModalRecurrence& r, Index l, Index steps) {
  double sum = r.w0[l] + r.w1[l];
  for (Index k = 0; k < r.exponentials(); ++k) {
    const double E = r.decay(k, l);
    sum += r.output(k, l) * (E < 1 ? (1 - std::pow(E, double(steps))) / (1 - E) : double(steps));
  }
  return sum;
}

}  // namespace

std::optional<Smoothing> best_smoothing(const LcpMatrix& matrix, const ModalRecurrence& r, Index steps) {
  const std::optional<Vector> all = eigenvalues(matrix);
  if (!all) return std::nullopt;
  const Index n = all->size(), modes = std::min(n, most_modes);
  ComplexMatrix K(modes, frequencies), K_smooth(modes, 1);
  Vector M(modes);
  for (Index i = 0; i < modes; ++i) {
    const Index l = modes > 1 ? i * (n - 1) / (modes - 1) : 0;
    M[i] = (*all)[l];
    K_smooth(i, 0) = sum_of_weights(r, l, steps);
    for (Index f = 0; f < frequencies; ++f)
      K(i, f) = symbol(r, l, std::numbers::pi * (0.25 + 0.75 * double(f) / double(frequencies - 1)));
  }
  const auto factor = [&](const ComplexMatrix& symbols, double D) {
    return ((symbols.array() - D).abs2().rowwise().maxCoeff().sqrt() / (M.array() + D)).maxCoeff();
  };
  Smoothing best{0, factor(K, 0), 0};
  const double lowest = (least_diagonal - 1) * all->minCoeff(), highest = all->maxCoeff();
  for (Index i = 0; i <= candidates; ++i) {
    const double D = lowest + (highest - lowest) * double(i) / double(candidates);
    if (const double f = factor(K, D); f < best.factor) best = {D, f, 0};
  }
  best.smooth_factor = factor(K_smooth, best.shift);
  return best;
}

}  // namespace bromwich
