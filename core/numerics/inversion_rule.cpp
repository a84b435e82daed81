#include "core/numerics/inversion_rule.hpp"

#include "core/base/require.hpp"
#include "core/base/text.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

constexpr double pi = std::numbers::pi;
constexpr Index most_nodes = 100000;

// Two windows a decade: powers of t lose little from one end to the other.
const double ratio_of_windows = std::sqrt(10.0);
// Windows to the right of all t, in which singularities are found: Re s up to about 3/t1 of the last.
constexpr int windows_beside = 6;
constexpr int most_windows = 800;

// The rule that gives f, and the one beside it.
constexpr InversionAccuracy first_rule{36, 4}, second_rule{36, 3.4};
// The hyperbola that bounds the error on the left keeps this distance/t1 from the singularities: F = s^{-4} is not
// large there.
constexpr double nearest = 1;
constexpr double second_window = 1.3;  ///< it is for [t0/1.3, 1.3 t1]

std::optional<InversionHyperbola> searched(double half_height, double ratio, const InversionAccuracy& a) {
  std::optional<InversionHyperbola> best;
  const double L = a.digits;
  double fewest = double(most_nodes);
  for (double alpha = 1.4; alpha > 1e-5; alpha *= alpha > 0.3 ? 0.95 : 0.85)
    for (double m = a.growth; m < 300; m *= 1.08) {
      const double vertex = std::sin(alpha);
      if (m * (1 - vertex) > a.growth) break;
      // The hyperbola through c ± i omega: cos^2/sin of its angle is omega/m.
      const double tan = half_height / m, corner = 2 / (tan + std::sqrt(tan * tan + 4));
      const double left = std::min(corner, 1 - nearest / m), d = std::asin(left) - alpha;
      if (!(d > 0)) continue;
      const double spacing = 2 * pi * std::min(d / (L + m * (1 - left)), alpha / (L + m));
      const double nodes = std::ceil(std::acosh((L * ratio / m + 1) / vertex) / spacing);
      if (!(nodes < fewest)) continue;
      fewest = nodes;
      best = InversionHyperbola{m, alpha, spacing, Index(nodes)};
    }
  return best;
}

// Half-lines that share a hyperbola: the left ends of their cuts do not matter.
struct Cluster {
  double right, low, high;
  double middle() const { return (low + high) / 2; }
  double half_height() const { return (high - low) / 2; }
};

// How far a hyperbola with its ends reaches above its middle, on the vertical line that bounds the region in which F
// must be analytic.
double reach(const InversionHyperbola& h, double t1) {
  return h.scale / t1 * std::sinh(h.spacing * double(h.nodes + 1));
}

std::vector<Cluster> lines_of(const std::vector<Complex>& points, bool real) {
  std::vector<Cluster> lines;
  const auto add = [&](Complex s) {
    for (Cluster& line : lines)
      if (line.low == s.imag()) {
        line.right = std::max(line.right, s.real());
        return;
      }
    lines.push_back({s.real(), s.imag(), s.imag()});
  };
  for (const Complex s : points) {
    add(s);
    if (real) add(std::conj(s));
  }
  if (lines.empty()) lines.push_back({0, 0, 0});
  std::sort(lines.begin(), lines.end(), [](const Cluster& a, const Cluster& b) { return a.low < b.low; });
  return lines;
}

InversionHyperbola hyperbola_of(const Cluster& c, double t0, double t1, const InversionAccuracy& accuracy) {
  const auto found = inversion_hyperbola(c.half_height() * t1, t1 / t0, accuracy);
  if (!found)
    throw Error(
        "singularities",
        text("lie %.3g apart, which at t = %.3g needs more than %td points", 2 * c.half_height(), t1, most_nodes),
        "give fewer of them, or smaller t");
  return *found;
}

// Neighbours whose hyperbolas come too close to each other's half-lines share one.
std::vector<Cluster> clusters_of(std::vector<Cluster> all, double t0, double t1, const InversionAccuracy& accuracy) {
  for (bool merged = true; merged && all.size() > 1;) {
    merged = false;
    std::vector<Cluster> next;
    std::vector<double> beyond;
    for (const Cluster& c : all) {
      // Where a shared hyperbola has too many nodes, this one is as far as it must be from others.
      const auto h = inversion_hyperbola(c.half_height() * t1, t1 / t0, accuracy);
      const double here = h ? reach(*h, t1) - c.half_height() : 0;
      if (!next.empty() && c.low - next.back().high < 1.2 * std::max(here, beyond.back())) {
        next.back() = {std::max(next.back().right, c.right), next.back().low, c.high};
        beyond.back() = std::max(here, beyond.back());
        merged = true;
        continue;
      }
      next.push_back(c);
      beyond.push_back(here);
    }
    all = next;
  }
  return all;
}

}  // namespace

std::optional<InversionHyperbola> inversion_hyperbola(double half_height, double ratio, const InversionAccuracy& a) {
  // Most are around one half-line, for one of the two windows.
  struct Kept {
    double ratio, digits, growth;
    std::optional<InversionHyperbola> found;
  };
  thread_local std::array<Kept, 4> kept{};
  thread_local std::size_t next = 0;
  if (half_height != 0) return searched(half_height, ratio, a);
  for (const Kept& k : kept)
    if (std::abs(k.ratio - ratio) <= 1e-9 * ratio && k.digits == a.digits && k.growth == a.growth) return k.found;
  kept[next++ % kept.size()] = {ratio, a.digits, a.growth, searched(0, ratio, a)};
  return kept[(next - 1) % kept.size()].found;
}

InversionRule inversion_rule(const std::vector<Complex>& singularities, bool real, double t0, double t1,
                             const InversionAccuracy& accuracy) {
  std::vector<Complex> centre, offset, weight;
  std::vector<double> outermost;
  for (const Cluster& c : clusters_of(lines_of(singularities, real), t0, t1, accuracy)) {
    const double middle = c.middle();
    const bool symmetric = real && c.low == -c.high;
    if (real && !symmetric && middle < 0) continue;
    const InversionHyperbola h = hyperbola_of(c, t0, t1, accuracy);
    const double scale = h.scale / t1;
    for (Index p = symmetric ? 0 : -h.nodes; p <= h.nodes; ++p) {
      const Complex angle(-h.alpha, double(p) * h.spacing);
      centre.emplace_back(c.right, middle);
      offset.push_back(scale * (1.0 + std::sin(angle)));
      // 1/(2 pi i) s'(v) dv with s' = scale i cos(iv - alpha).
      weight.push_back(h.spacing * scale / (2 * pi) * std::cos(angle) * (real && (p != 0 || !symmetric) ? 2.0 : 1.0));
      outermost.push_back(std::abs(p) == h.nodes ? 1 : 0);
    }
  }
  const auto n = Index(weight.size());
  InversionRule rule{t0, t1, {}, {}, {}, {}};
  rule.centre = Eigen::Map<ComplexVector>(centre.data(), n);
  rule.offset = Eigen::Map<ComplexVector>(offset.data(), n);
  rule.weight = Eigen::Map<ComplexVector>(weight.data(), n);
  rule.outermost = Eigen::Map<Vector>(outermost.data(), n);
  return rule;
}

InversionRule talbot_rule(Complex centre, bool real, double t, Index N) {
  const Index count = real ? N / 2 : N;
  InversionRule rule{
      t, t, ComplexVector::Constant(count, centre), ComplexVector(count), ComplexVector(count), Vector::Zero(count)};
  const double scale = double(N) / t, a = 0.6407;
  for (Index p = 0; p < count; ++p) {
    const double v = real ? (2 * double(p) + 1) * pi / double(N) : -pi + (2 * double(p) + 1) * pi / double(N);
    const double cot = 1 / std::tan(a * v), sine = std::sin(a * v);
    rule.offset[p] = scale * Complex(0.5017 * v * cot - 0.6122, 0.2645 * v);
    const Complex slope = scale * Complex(0.5017 * (cot - a * v / (sine * sine)), 0.2645);
    rule.weight[p] = slope / (Complex(0, 1) * double(N)) * (real ? 2.0 : 1.0);
  }
  return rule;
}

InversionWeights inversion_weights(const InversionRule& rule, const Vector& t, double accuracy) {
  InversionWeights w{ComplexMatrix(t.size(), rule.size()), Matrix(t.size(), rule.size())};
  ComplexVector shift;  // e^{centre t}
  for (Index p = 0; p < rule.size(); ++p) {
    const Complex centre = rule.centre[p], offset = rule.offset[p];
    if (p == 0 || centre != rule.centre[p - 1]) shift = (centre * t.cast<Complex>()).array().exp();
    const double lost = 4 * std::max(1.0, accuracy / epsilon) + std::abs(centre + offset) / std::abs(offset);
    for (Index i = 0; i < t.size(); ++i) {
      const Complex at = offset * t[i];
      const double size = std::exp(at.real());
      w.value(i, p) = rule.weight[p] * shift[i] * Complex(size * std::cos(at.imag()), size * std::sin(at.imag()));
    }
    w.error.col(p) =
        w.value.col(p).cwiseAbs().array() * (epsilon * (lost + std::abs(offset) * t.array()) + rule.outermost[p]);
  }
  return w;
}

std::vector<InversionWindow> inversion_windows(const Vector& t, const InversionOptions& options) {
  for (Index i = 0; i < t.size(); ++i)
    if (!(t[i] > 0) || !std::isfinite(t[i])) throw Error("t", text("has the entry %g", t[i]), "give times above 0");
  for (const Complex s : options.singularities)
    if (!std::isfinite(s.real()) || !std::isfinite(s.imag()))
      throw Error("singularities", text("has the point %g%+gi", s.real(), s.imag()), "give finite points");
  std::vector<InversionWindow> windows;
  if (t.size() == 0) return windows;
  const double largest = t.maxCoeff(), least = t.minCoeff();
  const auto window_of = [&](double at) {
    const double decades = std::log10(largest) - std::log10(at);
    return int(std::floor(decades / std::log10(ratio_of_windows) * (1 - 4 * epsilon)));
  };
  const int count = window_of(least) + 1 + windows_beside;
  if (count > most_windows || !(least / std::pow(ratio_of_windows, windows_beside + 1) > 0))
    throw Error("t", text("lies between %g and %g", least, largest), "give times of fewer decades");
  windows.resize(std::size_t(count));
  for (Index i = 0; i < t.size(); ++i) windows[std::size_t(window_of(t[i]))].rows.push_back(i);
  for (int k = 0; k < count; ++k) {
    InversionWindow& window = windows[std::size_t(k)];
    const double t1 = largest * std::pow(ratio_of_windows, -k), t0 = largest * std::pow(ratio_of_windows, -k - 1);
    window.rule = inversion_rule(options.singularities, options.real, t0, t1, first_rule);
    window.second =
        inversion_rule(options.singularities, options.real, t0 / second_window, second_window * t1, second_rule);
    Vector times(Index(window.rows.size()) + 2);
    for (std::size_t i = 0; i < window.rows.size(); ++i) times[Index(i)] = t[window.rows[i]];
    times.tail(2) << t0, t1;
    window.weights = inversion_weights(window.rule, times, options.accuracy);
    window.second_weights = inversion_weights(window.second, times, options.accuracy);
  }
  return windows;
}

std::vector<InversionRule> talbot_rules(const Vector& t, const InversionOptions& options) {
  const std::vector<Cluster> lines = lines_of(options.singularities, options.real);
  if (lines.size() > 1)
    throw Error("contour", text("is talbot, and singularities lie on %zu half-lines", lines.size()), "use hyperbola");
  constexpr Index points = 26;  // 10^{-0.6 N} is rounding
  std::vector<InversionRule> rules;
  for (Index i = 0; i < t.size(); ++i)
    rules.push_back(talbot_rule({lines[0].right, lines[0].low}, options.real, t[i], points));
  return rules;
}

}  // namespace bromwich
