#include "core/multigrid/smoothing.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

constexpr Index frequencies = 24, most_modes = 48;  ///< of the sample; the symbols are smooth in both
constexpr Index octave = 6;                         ///< frequencies in each half of the remaining interval
constexpr Index candidates = 120;
constexpr double least_diagonal = 0.05;  ///< M + D I keeps this part of the smallest eigenvalue of M

using Row = Eigen::Array<double, 1, Eigen::Dynamic>;

// The modes of the sample, one entry each.
struct Sample {
  Row w0, w1;
  Eigen::Array<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> E, C;  ///< K x modes
};

struct Symbol {
  Row real, imaginary;
};

// K^_l(omega) from the recurrence: w0 + w1 e^{-i omega} + Σ_k C_k / (e^{i omega} - E_k).
Symbol symbol(const Sample& r, double omega) {
  const double c = std::cos(omega), s = std::sin(omega);
  Symbol K{r.w0 + c * r.w1, -s * r.w1};
  for (Index k = 0; k < r.E.rows(); ++k) {
    const Row weight = r.C.row(k) / ((c - r.E.row(k)).square() + s * s);
    K.real += weight * (c - r.E.row(k));
    K.imaginary -= s * weight;
  }
  return K;
}

// Σ_{d<=steps} W_d. A fit of exponentials is valid up to there only: its slowest terms may be meaningless beyond.
Row sum_of_weights(const Sample& r, Index steps) {
  Row sum = r.w0 + r.w1;
  for (Index k = 0; k < r.E.rows(); ++k) {
    const auto E = r.E.row(k);
    sum += r.C.row(k) * (E < 1).select((1 - (double(steps) * E.log()).exp()) / (1 - E), double(steps));
  }
  return sum;
}

// `count` modes from the smoothest to the roughest one: those at equally spaced ranks, found without sorting all.
std::vector<Index> spread(const Vector& values, Index count) {
  const Index n = values.size();
  std::vector<std::pair<double, Index>> order;
  for (Index l = 0; l < n; ++l) order.emplace_back(values[l], l);
  const auto rank = [&](Index i) { return i > 0 ? i * (n - 1) / (count - 1) : 0; };
  // Ranks from .. to - 1 are among the places first .. last - 1.
  const auto place = [&](const auto& self, Index from, Index to, Index first, Index last) -> void {
    if (from == to) return;
    const Index middle = (from + to) / 2, at = rank(middle);
    std::nth_element(order.begin() + first, order.begin() + at, order.begin() + last);
    self(self, from, middle, first, at);
    self(self, middle + 1, to, at + 1, last);
  };
  place(place, 0, count, 0, n);
  std::vector<Index> found;
  for (Index i = 0; i < count; ++i) found.push_back(order[std::size_t(rank(i))].second);
  return found;
}

}  // namespace

SweptMatrix::SweptMatrix(const LcpMatrix& M, const FaceBasis& basis) : stencil(stencil_in(basis, M)) {
  if (stencil) eigenvalues = stencil->eigenvalues();
}

std::optional<Smoothing> best_smoothing(const SweptMatrix& swept, const ModalRecurrence& r, Index steps,
                                        double useful) {
  if (!swept.stencil || *std::max_element(swept.stencil->beside.begin(), swept.stencil->beside.end()) > 0 ||
      !(swept.eigenvalues.minCoeff() > 0))
    return std::nullopt;
  const Vector& all = swept.eigenvalues;
  const Index n = all.size(), modes = std::min(n, most_modes);
  const std::vector<Index> l = spread(all, modes);
  const Row M = all(l).transpose();
  const Sample sample{r.w0(l), r.w1(l), r.decay(Eigen::all, l), r.output(Eigen::all, l)};
  const std::vector<Symbol> smooth{{sum_of_weights(sample, steps), Row::Zero(modes)}};
  std::vector<Symbol> K;
  for (Index f = 0; f < frequencies; ++f)
    K.push_back(symbol(sample, std::numbers::pi * (0.25 + 0.75 * double(f) / double(frequencies - 1))));
  const auto factor = [&](const std::vector<Symbol>& symbols, double D) {
    Row largest = Row::Zero(modes);
    for (const Symbol& s : symbols) largest = largest.max((s.real - D).square() + s.imaginary.square());
    return (largest.sqrt() / (M + D)).maxCoeff();
  };
  Smoothing best{0, {factor(K, 0)}, 0};
  const double lowest = (least_diagonal - 1) * all.minCoeff(), highest = all.maxCoeff();
  for (Index i = 0; i <= candidates; ++i) {
    const double D = lowest + (highest - lowest) * double(i) / double(candidates);
    if (const double f = factor(K, D); f < best.factor()) best = {D, {f}, 0};
  }
  best.smooth_factor = factor(smooth, best.shift);
  // One octave more for each grid.
  for (double edge = std::numbers::pi / 4; best.unseen.back() < useful && edge * double(steps) > std::numbers::pi;) {
    edge /= 2;
    std::vector<Symbol> lower;
    for (Index f = 0; f < octave; ++f) lower.push_back(symbol(sample, edge * (1 + double(f) / double(octave))));
    best.unseen.push_back(std::max(best.unseen.back(), factor(lower, best.shift)));
  }
  return best;
}

}  // namespace bromwich
