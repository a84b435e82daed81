#include "core/galerkin/sources.hpp"

#include "core/base/interruption.hpp"
#include "core/numerics/matrix_phi.hpp"
#include "core/numerics/phi.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double same_time = 1e-9;       ///< of an interval: a breakpoint closer to a node counts as on it
constexpr double missed = 0.25;          ///< of the range of the values on a piece
constexpr double rounding_range = 1e-9;  ///< of the largest value: smaller differences do not count
constexpr int most_halvings = 16;
constexpr std::size_t most_responses = 256;
/// Irregular points between the Gauss points. `more_probes` are near the ends, for sources found to be rough.
constexpr double probes[] = {0.2347, 0.7031}, more_probes[] = {0.0131, 0.0607, 0.9417, 0.9883};

// Gauss points on [0,1], their weights, and the parabola through values there: Σ_i values_i parabola(i, j) s^j / j!.
struct GaussParabola {
  Eigen::Vector3d points, weights;
  Eigen::Matrix3d parabola;
};

GaussParabola make_gauss() {
  const double d = std::sqrt(0.15);
  GaussParabola gauss{{0.5 - d, 0.5, 0.5 + d}, {5. / 18, 8. / 18, 5. / 18}, {}};
  Eigen::Matrix3d powers;  // row i: 1, s_i, s_i^2 / 2
  for (int i = 0; i < 3; ++i) powers.row(i) << 1, gauss.points[i], gauss.points[i] * gauss.points[i] / 2;
  gauss.parabola = powers.inverse().transpose();
  return gauss;
}

const GaussParabola gauss = make_gauss();

// The parabola through `values` misses `value` at s.
bool misses(const std::array<Vector, 3>& values, const Vector& value, double s, Vector& range) {
  const Eigen::Vector3d weights = gauss.parabola * Eigen::Vector3d(1, s, s * s / 2);
  for (Index c = 0; c < value.size(); ++c) {
    const double a = values[0][c], b = values[1][c], e = values[2][c];
    range[c] = std::max({range[c], std::abs(a), std::abs(b), std::abs(e), std::abs(value[c])});
    const auto [low, high] = std::minmax({a, b, e, value[c]});
    const double apart = std::abs(weights[0] * a + weights[1] * b + weights[2] * e - value[c]);
    if (apart > missed * (high - low) && apart > rounding_range * range[c]) return true;
  }
  return false;
}

}  // namespace

GalerkinSources::GalerkinSources(const Scene& scene, const DenseDynamics& d, const Matrix& entry,
                                 std::vector<double> breakpoints)
    : scene_(scene),
      dynamics_(d),
      entry_(entry),
      breakpoints_(std::move(breakpoints)),
      range_f_(Vector::Zero(scene.sources())),
      range_g_(Vector::Zero(scene.constraints())) {}

const GalerkinSources::Response& GalerkinSources::response(double length) {
  const auto known = responses_.find(length);
  if (known != responses_.end()) return known->second;
  if (responses_.size() >= most_responses) responses_.clear();
  const std::vector<Matrix> G = matrix_phis(length * dynamics_.A, 5);
  const Matrix& N = dynamics_.N;
  const Index m = entry_.rows(), k = entry_.cols(), n = N.rows();
  Response r{{}, {}, G[0], Matrix(2 * n, m)};
  r.C << 2 * N * G[2], 2 * N * (G[1] - G[2]);
  for (int i = 0; i < 3; ++i) {
    Matrix state = Matrix::Zero(m, k), moments = Matrix::Zero(2 * n, k);
    for (int j = 0; j < 3; ++j) {  // s^j/j! responds with s^{j+1} phi_{j+1}(s hA), whose moments are these
      const auto& phi = [&](int order) -> const Matrix& { return G[std::size_t(j + order)]; };
      const double c = length * gauss.parabola(i, j);
      state += c * phi(1) * entry_;
      moments.topRows(n) += 2 * c * N * phi(3) * entry_;
      moments.bottomRows(n) += 2 * c * N * (phi(2) - phi(3)) * entry_;
    }
    r.state[std::size_t(i)] = state;
    r.moments[std::size_t(i)] = moments;
  }
  return responses_[length] = std::move(r);
}

GalerkinSources::Samples GalerkinSources::sample(double t, double length) {
  Samples s;
  for (std::size_t i = 0; i < 3; ++i) {
    const double at = t + gauss.points[Index(i)] * length;
    s.f[i].resize(scene_.sources());
    s.g[i].resize(scene_.constraints());
    if (scene_.f) scene_.f(at, s.f[i]);
    if (scene_.g) scene_.g(at, s.g[i]);
  }
  return s;
}

bool GalerkinSources::agrees(double t, double length, const Samples& s, double probe) {
  if (scene_.f) {
    Vector f(scene_.sources());
    scene_.f(t + probe * length, f);
    if (misses(s.f, f, probe, range_f_)) return false;
  }
  if (!scene_.g) return true;
  Vector g(scene_.constraints());
  scene_.g(t + probe * length, g);
  return !misses(s.g, g, probe, range_g_);
}

bool GalerkinSources::resolved(double t, double length, const Samples& s) {
  return std::all_of(std::begin(probes), std::end(probes), [&](double at) { return agrees(t, length, s, at); });
}

bool GalerkinSources::well_resolved(double t, double length, const Samples& s) {
  return resolved(t, length, s) && std::all_of(std::begin(more_probes), std::end(more_probes),
                                               [&](double at) { return agrees(t, length, s, at); });
}

bool GalerkinSources::breaks(double t, double h) const {
  const auto first = std::lower_bound(breakpoints_.begin(), breakpoints_.end(), t + same_time * h);
  return first != breakpoints_.end() && *first < t + (1 - same_time) * h;
}

void GalerkinSources::split(double t, double h, double begin, double end, int depth, std::vector<SourcePart>& parts) {
  check_interruption();
  const double from = t + begin * h, length = (end - begin) * h;
  if (depth < most_halvings && !well_resolved(from, length, sample(from, length))) {
    const double middle = (begin + end) / 2;
    split(t, h, begin, middle, depth + 1, parts);
    split(t, h, middle, end, depth + 1, parts);
  } else {
    parts.push_back({begin, end});
  }
}

std::vector<SourcePart> GalerkinSources::parts(double t, double h) {
  std::vector<SourcePart> all;
  double begin = 0;
  auto next = std::lower_bound(breakpoints_.begin(), breakpoints_.end(), t + same_time * h);
  for (; next != breakpoints_.end() && *next < t + (1 - same_time) * h; ++next) {
    const double end = (*next - t) / h;
    if (end - begin <= same_time) continue;
    split(t, h, begin, end, 0, all);
    begin = end;
  }
  split(t, h, begin, 1, 0, all);
  return all;
}

void GalerkinSources::add_piece(double length, const Samples& s, Eigen::Ref<Vector> F, Eigen::Ref<Vector> q) {
  const Response& r = response(length);
  const Index n = dynamics_.N.rows();
  for (std::size_t i = 0; i < 3; ++i) {
    if (scene_.f) {
      F += r.state[i] * s.f[i];
      q += r.moments[i] * s.f[i];
    }
    if (scene_.g) {
      const double at = gauss.points[Index(i)];
      q.head(n) += 2 * gauss.weights[Index(i)] * (1 - at) * s.g[i];
      q.tail(n) += 2 * gauss.weights[Index(i)] * at * s.g[i];
    }
  }
}

void GalerkinSources::add(double t, double h, Eigen::Ref<Vector> F, Eigen::Ref<Vector> q) {
  if (!scene_.f && !scene_.g) return;
  const Samples whole = sample(t, h);
  if (!breaks(t, h) && resolved(t, h, whole)) return add_piece(h, whole, F, q);
  ++divided_;
  const Index n = dynamics_.N.rows();
  Vector x = Vector::Zero(F.size()), own_F(F.size()), p(q.size());
  for (const SourcePart& part : parts(t, h)) {
    const double d = part.end - part.begin, from = t + part.begin * h;
    own_F.setZero();
    p.setZero();
    add_piece(d * h, sample(from, d * h), own_F, p);
    const Response& r = response(d * h);
    p += r.C * x;
    q.head(n) += d * ((1 - part.begin) * p.head(n) + (1 - part.end) * p.tail(n));
    q.tail(n) += d * (part.begin * p.head(n) + part.end * p.tail(n));
    x = (r.E * x + own_F).eval();
  }
  F += x;
}

Vector GalerkinSources::mean_of_f(double t, double h) {
  Vector mean = Vector::Zero(scene_.sources());
  if (!scene_.f) return mean;
  for (const SourcePart& part : parts(t, h)) {
    const Samples s = sample(t + part.begin * h, (part.end - part.begin) * h);
    for (std::size_t i = 0; i < 3; ++i) mean += (part.end - part.begin) * gauss.weights[Index(i)] * s.f[i];
  }
  return mean;
}

}  // namespace bromwich
