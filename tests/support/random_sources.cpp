#include "tests/support/random_sources.hpp"

#include "tests/support/random_draws.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <set>
#include <utility>

namespace bromwich::oracle {
namespace {

constexpr double pi = std::numbers::pi;

/// One component of a source on [0, T].
struct Signal {
  std::function<double(double)> value;
  std::vector<double> breaks = {};
  double step = INFINITY;  ///< short compared with the variation between breaks
};

std::vector<double> multiples(double period, double first, double T) {
  std::vector<double> times;
  for (double t = first; t < T; t += period)
    if (t > 0) times.push_back(t);
  return times;
}

double zero_of_sine(double omega, double phase) {  // the first zero after t = 0
  const double turns = phase / pi;
  return (std::ceil(turns) - turns) * pi / omega;
}

Signal sine(Draw& d, double T, double least, double most) {
  const double omega = 2 * pi * d.uniform(least, most) / T, phase = d.uniform(0, 3);
  return {[=](double t) { return std::sin(omega * t + phase); }, {}, 1.5 / omega};
}

Signal square(Draw& d, double T) {
  const double omega = 2 * pi * d.uniform(1, d.chance(0.3) ? 60 : 8) / T, phase = d.uniform(0, 3);
  return {[=](double t) { return std::sin(omega * t + phase) >= 0 ? 1.0 : -1.0; },
          multiples(pi / omega, zero_of_sine(omega, phase), T)};
}

/// A sine times the sign of another one (jumps); or |sin|, or max(0, sin) (kinks).
Signal cut_sine(Draw& d, double T, int kind) {
  const double omega = 2 * pi * d.uniform(0.7, 9) / T, phase = d.uniform(0, 3), slow = 5 / T;
  const auto value = [=](double t) {
    const double s = std::sin(omega * t + phase);
    return kind == 0 ? (s >= 0 ? 1 : -1) * std::cos(slow * t) : kind == 1 ? std::abs(s) : std::max(0.0, s);
  };
  return {value, multiples(pi / omega, zero_of_sine(omega, phase), T), 1.5 / omega};
}

Signal pwm(Draw& d, double T) {
  const double periods = std::floor(d.uniform(3, 25)), period = T / periods, depth = d.uniform(0.1, 0.45);
  std::vector<double> edges;
  for (int k = 0; k < int(periods); ++k) {
    edges.push_back(double(k) * period);
    edges.push_back((double(k) + 0.5 + depth * std::sin(2 * pi * double(k) / periods)) * period);
  }
  const auto value = [edges](double t) {
    return (std::upper_bound(edges.begin(), edges.end(), t) - edges.begin()) % 2 == 1 ? 1.0 : 0.0;
  };
  return {value, {edges.begin() + 1, edges.end()}};
}

Signal pulses(Draw& d, double T) {
  std::vector<double> edges;
  const Index count = d.index(1, 3);
  for (Index k = 0; k < count; ++k) {
    const double width = T * std::pow(10, -d.uniform(0.8, 3.5)) / double(count);
    edges.push_back(T * (double(k) + d.uniform(0.05, 0.8)) / double(count));
    edges.push_back(edges.back() + width);
  }
  const double height = std::min(0.5 * T / (edges[1] - edges[0]), d.chance(0.5) ? 3.0 : 200.0);
  const auto value = [=](double t) {
    return (std::upper_bound(edges.begin(), edges.end(), t) - edges.begin()) % 2 == 1 ? height : 0.0;
  };
  return {value, edges};
}

Signal table(Draw& d, double T, bool steps) {
  std::vector<double> knots{0}, values{d.uniform(-1, 1)};
  for (Index left = d.index(4, 30); left > 0; --left) {
    knots.push_back(knots.back() + d.uniform(0.05, 1));
    values.push_back(d.uniform(-1, 1));
  }
  for (double& t : knots) t *= T / knots.back() * (&t == &knots.back() ? 1 + 1e-9 : 1);
  const auto value = [=](double t) {
    const auto at = std::upper_bound(knots.begin(), knots.end(), t) - knots.begin();
    const std::size_t k = std::size_t(std::clamp<long>(at - 1, 0, long(knots.size()) - 2));
    if (steps) return values[k];
    const double s = std::clamp((t - knots[k]) / (knots[k + 1] - knots[k]), 0.0, 1.0);
    return values[k] + s * (values[k + 1] - values[k]);
  };
  return {value, {knots.begin() + 1, knots.end() - 1}};
}

Signal ramps(Draw& d, double T, bool stairs) {
  const double period = T / d.uniform(1.2, 20), height = 2 * period / T;
  const auto value = [=](double t) {
    const double turns = t / period;
    return stairs ? height * std::floor(turns) : turns - std::floor(turns);
  };
  return {value, multiples(period, period, T)};
}

Signal step_at(Draw& d, double T) {
  const double at = T * d.uniform(0.02, 0.98);
  return {[=](double t) { return t >= at ? 1.0 : 0.0; }, {at}};
}

Signal exponential_signal(Draw& d, double T) {
  const double rate = d.uniform(-20, 6) / T;
  return {[=](double t) { return std::exp(rate * t); }, {}, 1 / std::abs(rate)};
}

Signal bump(Draw& d, double T) {
  const double middle = T * d.uniform(0.1, 0.9), width = T * std::pow(10, -d.uniform(1, 3));
  // Beyond 7 widths it is below 1e-21. Breakpoints there keep the oracle's steps from missing it.
  std::vector<double> breaks;
  for (const double k : {-7, -3, 0, 3, 7})
    if (middle + k * width > 0 && middle + k * width < T) breaks.push_back(middle + k * width);
  return {[=](double t) { return std::exp(-0.5 * std::pow((t - middle) / width, 2)); }, breaks};
}

constexpr std::array kinds{"sine",     "constant", "square",  "pwm",     "pulse",     "table", "step table", "stairs",
                           "sawtooth", "sign*cos", "abs sin", "max sin", "fast sine", "exp",   "step",       "bump"};

Signal signal(Draw& d, Index kind, double T) {
  switch (kind) {
    case 0:
      return sine(d, T, 0.1, 1.5);
    case 1:
      return {[](double) { return 1.0; }};
    case 2:
      return square(d, T);
    case 3:
      return pwm(d, T);
    case 4:
      return pulses(d, T);
    case 5:
      return table(d, T, false);
    case 6:
      return table(d, T, true);
    case 7:
      return ramps(d, T, true);
    case 8:
      return ramps(d, T, false);
    case 9:
    case 10:
    case 11:
      return cut_sine(d, T, int(kind) - 9);
    case 12:
      return sine(d, T, 210, 420);  // 400 steps resolve up to 200
    case 13:
      return exponential_signal(d, T);
    case 14:
      return step_at(d, T);
    default:
      return bump(d, T);
  }
}

/// `size` components with two kinds of sources and smooth ones.
struct Sources {
  TimeFunction function;
  std::vector<double> breaks;
  double step = INFINITY;
};

Sources sources(Draw& d, Index size, double amplitude, double T, std::array<Index, 2> palette,
                std::set<std::string>& names) {
  std::vector<std::pair<double, std::function<double(double)>>> rows;
  Sources made;
  for (Index i = 0; i < size; ++i) {
    const Index kind = d.chance(0.7) ? palette[std::size_t(d.index(0, 1))] : d.index(0, 1);
    const Signal s = signal(d, kind, T);
    names.insert(kinds[std::size_t(kind)]);
    rows.emplace_back(amplitude * d.uniform(-1, 1), s.value);
    made.breaks.insert(made.breaks.end(), s.breaks.begin(), s.breaks.end());
    made.step = std::min(made.step, s.step);
  }
  made.function = [rows](double t, Eigen::Ref<Vector> v) {
    for (Index i = 0; i < v.size(); ++i) v[i] = rows[std::size_t(i)].first * rows[std::size_t(i)].second(t);
  };
  return made;
}

TimeFunction in_units_of(const TimeFunction& function, double factor, double time) {
  if (!function) return {};
  return [=](double t, Eigen::Ref<Vector> v) {
    function(t / time, v);
    v *= factor;
  };
}

double drawn_unit(Draw& d) { return d.chance(0.12) ? std::pow(10, std::floor(d.uniform(-6, 7))) : 1; }

template <typename S>
void tell(S& scene, const std::vector<double>& breaks, double unit_t) {
  if constexpr (requires { scene.breakpoints; }) {
    scene.breakpoints = breaks;
    for (double& t : scene.breakpoints) t *= unit_t;
    const auto same = std::unique(scene.breakpoints.begin(), scene.breakpoints.end());
    scene.breakpoints.erase(same, scene.breakpoints.end());
  }
}

void change_units(Draw& d, SourceScene& made, DenseDynamics e, Matrix M) {
  Scene& s = made.scene;
  const double w = drawn_unit(d);
  made.unit_x = drawn_unit(d);
  made.unit_y = drawn_unit(d);
  made.unit_t = drawn_unit(d);
  const double x = made.unit_x, y = made.unit_y, t = made.unit_t;
  s.dynamics = DenseDynamics{e.A / t, x / (y * t) * e.B, w / x * e.N};
  s.M = Matrix(w / y * M);
  s.f = in_units_of(s.f, s.f_entry == SourceEntry::through_B ? y : x / t, t);
  s.g = in_units_of(s.g, w, t);
  s.x0 *= x;
  s.T *= t;
}

}  // namespace

SourceScene source_scene(std::uint32_t seed) {
  Draw d(seed + 77777);
  SourceScene made;
  made.family = Family(seed % families);
  made.spectrum = Spectrum(d.index(0, spectra - 1));
  const Index m = d.index(1, 4);
  Index n = d.index(made.family == Family::duplicated ? 2 : 1, 3);
  if (made.family == Family::zero) n = std::min(n, m);
  Scene& scene = made.scene;
  scene.name = "sources-" + std::to_string(seed);
  scene.T = d.uniform(0.3, 3);
  Matrix M = complementarity_matrix(d, made.family, n);
  DenseDynamics e{state_matrix(d, made.spectrum, m), d.matrix(m, n), d.matrix(n, m)};
  const bool monotone = made.family == Family::zero || made.family == Family::low_rank || made.family == Family::skew;
  if (d.chance(monotone ? 0.9 : 0.4)) e.N = e.B.transpose();
  if (made.family == Family::duplicated) {
    std::vector<Index> owner{0};
    for (Index i = 1; i < n; ++i) owner.push_back(i == n - 1 ? d.index(0, i - 1) : i);
    M = M(owner, owner).eval();
    e.B = e.B(Eigen::all, owner).eval();
    e.N = e.N(owner, Eigen::all).eval();
  }
  std::set<std::string> names;
  const auto pick = [&] {
    const Index kind = d.index(0, Index(kinds.size()) - 1);
    return kind == 12 && d.chance(0.6) ? 2 : kind;
  };
  const std::array<Index, 2> palette{pick(), pick()};
  scene.f_entry = d.chance(0.2) ? SourceEntry::through_B : SourceEntry::state;
  const Sources f = sources(d, scene.f_entry == SourceEntry::through_B ? n : m, 3, scene.T, palette, names);
  const Sources g = sources(d, n, d.uniform(0.5, 3), scene.T, palette, names);
  scene.f = f.function;
  if (d.chance(0.85)) scene.g = g.function;
  scene.x0 = d.vector(m);
  scene.M = M;
  scene.dynamics = e;
  for (const std::string& name : names) made.sources += (made.sources.empty() ? "" : ", ") + name;

  std::vector<double>& breaks = made.base.breaks;
  breaks = f.breaks;
  breaks.insert(breaks.end(), g.breaks.begin(), g.breaks.end());
  std::sort(breaks.begin(), breaks.end());
  breaks.erase(std::unique(breaks.begin(), breaks.end()), breaks.end());
  made.base.scene = write_out(scene);
  made.base.longest_step = std::min(scene.T, std::min(f.step, g.step));
  change_units(d, made, e, M);
  made.told = d.chance(0.5);
  if (made.told) tell(scene, breaks, made.unit_t);
  return made;
}

Scene among_sparse_states(const Scene& scene, Index m) {
  const DenseDynamics& d = get<DenseDynamics>(scene.dynamics);
  const Index few = d.A.rows();
  SparseDynamics sparse;
  sparse.A.resize(m, m), sparse.B.resize(m, d.B.cols()), sparse.N.resize(d.N.rows(), m);
  for (Index i = 0; i < few; ++i) {
    for (Index k = 0; k < few; ++k) sparse.A.insert(i, k) = d.A(i, k);
    for (Index k = 0; k < d.B.cols(); ++k) sparse.B.insert(i, k) = d.B(i, k), sparse.N.insert(k, i) = d.N(k, i);
  }
  for (Index i = few; i < m; ++i) sparse.A.insert(i, i) = -2 / scene.T;
  Scene all = scene;
  all.dynamics = sparse;
  all.x0 = Vector::Zero(m);
  all.x0.head(few) = scene.x0;
  if (scene.f_entry != SourceEntry::state) return all;
  all.f_entry = SourceEntry::through_F;
  all.F.resize(m, few);
  for (Index i = 0; i < few; ++i) all.F.insert(i, i) = 1;
  return all;
}

}  // namespace bromwich::oracle
