#include "circuits/waveforms.hpp"

#include "core/base/error.hpp"
#include "core/numerics/legendre.hpp"
#include "core/result/located_solution.hpp"
#include "core/solve/dense_output.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

constexpr double shortest = 1e-12;   ///< of the span: shorter pieces are rounding of times
constexpr double inside = 1e-9;      ///< of a piece: where the value at its end is looked at
constexpr Index least_pieces = 200;  ///< of a span, where sources or the solution may bend more than its pieces show
constexpr double turn = 1;           ///< of e^{-i omega t} from the middle of a quadrature of order 16 to its ends
constexpr int around = 9, rounds = 12;

// Gauss-Legendre on [-1, 1], eight points (Abramowitz and Stegun, table 25.4).
constexpr std::array<double, 4> points{0.1834346424956498049394761, 0.5255324099163289858177390,
                                       0.7966664774136267395915539, 0.9602898564975362316835609};
constexpr std::array<double, 4> point_weights{0.3626837833783619829651504, 0.3137066458778872873379622,
                                              0.2223810344533744705443560, 0.1012285362903762591525314};

// Eight points and their weights on [-1, 1], increasing.
struct Gauss {
  static constexpr Index count = 2 * Index(points.size());
  Eigen::Matrix<double, count, 1> at, weights;
  /// Legendre coefficients of the polynomial through eight values.
  Eigen::Matrix<double, count, count> coefficients;

  Gauss() {
    const Index half = count / 2;
    for (Index i = 0; i < half; ++i) {
      at[half + i] = points[std::size_t(i)], at[half - 1 - i] = -points[std::size_t(i)];
      weights[half + i] = weights[half - 1 - i] = point_weights[std::size_t(i)];
    }
    static_assert(count == legendre_degree + 1);
    for (Index i = 0; i < count; ++i) coefficients.col(i) = weights[i] * legendre((1 + at[i]) / 2);
    for (Index k = 0; k < count; ++k) coefficients.row(k) *= double(2 * k + 1) / 2;
  }
};

const Gauss& gauss() {
  static const Gauss all;
  return all;
}

std::vector<double> edges_between(const Circuit& c, const Result& r, double from, double to) {
  std::vector<double> all;
  if (r.located) {
    for (const EventPiece& piece : r.located->pieces) all.push_back(piece.begin);
  } else {
    all.assign(r.t.begin(), r.t.end());
    for (const Switch& s : switches(r)) all.push_back(s.t);
  }
  for (const std::vector<double>* times : {&c.scene.breakpoints, &c.kinks})
    all.insert(all.end(), times->begin(), times->end());
  const Index least_number = r.located && c.u.linear() ? 1 : least_pieces;
  for (Index k = 1; k < least_number; ++k) all.push_back(from + (to - from) * double(k) / double(least_number));
  std::sort(all.begin(), all.end());
  const double least = shortest * (to - from);
  std::vector<double> edges{from};
  for (const double t : all)
    if (t > edges.back() + least && t < to - least) edges.push_back(t);
  edges.push_back(to);
  return edges;
}

}  // namespace

CircuitWaveforms::CircuitWaveforms(const Circuit& circuit, Backend& backend, const Result& result, double from,
                                   double to, const std::string& where)
    : circuit_(circuit), backend_(backend), result_(result) {
  if (result.x.cols() != circuit.scene.states() || result.t.size() == 0)
    throw Error(where, "needs all states, which were not recorded", "solve with all states");
  const double last = result.t[result.t.size() - 1], rounding = 1e-12 * last;
  if (!(from >= 0 && from < to && to <= last + rounding))
    throw Error(where, fmt::format("found the span {:.6g} to {:.6g}", from, to),
                fmt::format("give ascending times from 0 to {:.6g}", last));
  edges_ = edges_between(circuit, result, from, std::min(to, last));
  std::vector<double> times;
  std::vector<double> weights;
  for (std::size_t k = 0; k + 1 < edges_.size(); ++k) {
    const double middle = (edges_[k] + edges_[k + 1]) / 2, half = (edges_[k + 1] - edges_[k]) / 2;
    looks_.push_back(edges_[k] + inside * half);
    for (Index i = 0; i < Gauss::count; ++i) {
      times.push_back(middle + half * gauss().at[i]);
      weights.push_back(half * gauss().weights[i]);
      looks_.push_back(times.back());
    }
    looks_.push_back(edges_[k + 1] - inside * half);
  }
  t_ = Eigen::Map<const Vector>(times.data(), Index(times.size()));
  weights_ = Eigen::Map<const Vector>(weights.data(), Index(weights.size()));
  outputs_looks_ = outputs_at(looks_);
  ends_ = outputs_at({edges_.front(), edges_.back()});
  outputs_.resize(t_.size(), outputs_looks_.cols());
  const Index of_piece = Gauss::count;
  for (Index k = 0; k + 1 < Index(edges_.size()); ++k)
    outputs_.middleRows(k * of_piece, of_piece) = outputs_looks_.middleRows(k * (of_piece + 2) + 1, of_piece);
}

RowMatrix CircuitWaveforms::outputs_at(const std::vector<double>& times) const {
  return output_values(circuit_, at_times(circuit_.scene, backend_, result_, times));
}

Vector CircuitWaveforms::at(const Probe& p, const std::vector<double>& times) const {
  return p(Eigen::Map<const Vector>(times.data(), Index(times.size())), outputs_at(times));
}

std::vector<double> CircuitWaveforms::values(const Probe& p, const std::vector<double>& times) const {
  const Vector found = at(p, times);
  return {found.begin(), found.end()};
}

double CircuitWaveforms::integral(const Probe& p) const { return weights_.dot(p(t_, outputs_)); }

double CircuitWaveforms::rms(const Probe& p) const {
  return std::sqrt(weights_.dot(p(t_, outputs_).cwiseAbs2()) / (to() - from()));
}

double CircuitWaveforms::extreme(const Probe& p, double sign) const {
  std::vector<double> times = looks_;
  Vector found = sign * p(Eigen::Map<const Vector>(times.data(), Index(times.size())), outputs_looks_);
  double best = -INFINITY;
  for (int round = 0;; ++round) {
    Index k = 0;
    best = std::max(best, found.maxCoeff(&k));
    if (round == rounds / 3) return best;
    const double t = times[std::size_t(k)];
    const auto piece = std::upper_bound(edges_.begin(), edges_.end(), t);  // stays between the edges
    double low = piece == edges_.begin() ? t : *(piece - 1), high = piece == edges_.end() ? t : *piece;
    if (k > 0) low = std::max(low, times[std::size_t(k) - 1]);
    if (k + 1 < found.size()) high = std::min(high, times[std::size_t(k) + 1]);
    times.clear();
    for (int i = 1; i <= around; ++i) times.push_back(low + (high - low) * i / (around + 1));
    found = sign * at(p, times);
  }
}

// Of the polynomials through the points of the quadrature, in parts so short that e^{-i omega t} is resolved.
std::complex<double> CircuitWaveforms::spectrum(const Probe& p, double omega) const {
  const Vector values = p(t_, outputs_);
  const Gauss& g = gauss();
  std::complex<double> sum = 0;
  for (Index k = 0; k + 1 < Index(edges_.size()); ++k) {
    const double begin = edges_[std::size_t(k)], length = edges_[std::size_t(k) + 1] - begin;
    const Index parts = 1 + Index(std::abs(omega) * length / (2 * turn));
    const LegendreValues c = g.coefficients * values.segment<Gauss::count>(k * Gauss::count);
    for (Index part = 0; part < parts; ++part)
      for (Index i = 0; i < Gauss::count; ++i) {
        const double at = (double(part) + (1 + g.at[i]) / 2) / double(parts);
        const double phase = -omega * (begin + at * length - from());
        sum += length / double(2 * parts) * g.weights[i] * c.dot(legendre(at)) * std::polar(1.0, phase);
      }
  }
  return sum;
}

std::vector<std::complex<double>> CircuitWaveforms::harmonics(const Probe& p, Index count) const {
  const double T = to() - from();
  std::vector<std::complex<double>> found;
  for (Index k = 1; k <= count; ++k) found.push_back(2.0 / T * spectrum(p, 2 * std::numbers::pi * double(k) / T));
  return found;
}

std::vector<double> CircuitWaveforms::crossings(const Probe& p, int rising) const {
  struct Bracket {
    double low, high;
    bool up;
  };
  const Vector found = p(Eigen::Map<const Vector>(looks_.data(), Index(looks_.size())), outputs_looks_);
  std::vector<Bracket> brackets;
  bool above = found[0] > 0;
  for (Index j = 1; j < found.size(); ++j) {
    const bool now = found[j] > 0;
    if (now != above && (rising == 0 || (rising > 0) == now))
      brackets.push_back({looks_[std::size_t(j) - 1], looks_[std::size_t(j)], now});
    above = now;
  }
  for (int round = 0; round < rounds && !brackets.empty(); ++round) {
    std::vector<double> times;
    for (const Bracket& b : brackets)
      for (int i = 1; i <= around; ++i) times.push_back(b.low + (b.high - b.low) * i / (around + 1));
    const Vector values = at(p, times);
    for (std::size_t k = 0; k < brackets.size(); ++k)
      for (int i = 0; i < around; ++i) {
        const std::size_t at = k * around + std::size_t(i);
        if ((values[Index(at)] > 0) == brackets[k].up) {
          brackets[k].high = times[at];
          break;
        }
        brackets[k].low = times[at];
      }
  }
  std::vector<double> all;
  for (const Bracket& b : brackets) all.push_back((b.low + b.high) / 2);
  return all;
}

}  // namespace bromwich
