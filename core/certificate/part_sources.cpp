#include "core/certificate/part_sources.hpp"

#include "core/dynamics/dense.hpp"
#include "core/numerics/gauss_parabola.hpp"

#include <cmath>

namespace bromwich {

namespace {

constexpr double resolved = 0.01;   ///< of the largest value
constexpr double one_place = 0.73;  ///< of a part: not a node, and not the middle of two

bool differs(const Vector& value, const Vector& expected, Vector& size) {
  size = size.cwiseMax(value.cwiseAbs());
  return ((value - expected).cwiseAbs().array() > resolved * size.array()).any();
}

}  // namespace

PartSampler::PartSampler(const Scene& scene)
    : sources_(scene),
      has_f_(bool(scene.f)),
      has_g_(bool(scene.g)),
      zero_(Vector::Zero(scene.constraints())),
      size_of_f_(Vector::Zero(scene.states())),
      size_of_g_(zero_) {
  if (has_g_) at_ends_.emplace(scene.g, scene.constraints(), 64 * epsilon * scene.T);
}

PartSources PartSampler::on(const Part& p) const {
  PartSources s;
  const double d = p.to - p.from;
  if (has_f_) {
    std::array<Vector, 3> values;
    for (std::size_t k = 0; k < 3; ++k) values[k] = sources_.f(p.from + gauss_points[k] * d);
    s.f = gauss_parabola(values);
  }
  s.g[0] = has_g_ ? sources_.g(p.from + part_nodes[0] * d) : zero_;
  s.g[1] = has_g_ ? at_ends_->whole(at_ends_->before(p.to, d)) : zero_;
  return s;
}

bool PartSampler::resolves(const Part& p, const PartSources& s) {
  const double t = p.from + one_place * (p.to - p.from);
  if (has_f_ && differs(sources_.f(t), s.f[0] + one_place * (s.f[1] + one_place * s.f[2]), size_of_f_)) return false;
  if (!has_g_) return true;
  const double share = (one_place - part_nodes[0]) / (1 - part_nodes[0]);
  return !differs(sources_.g(t), (1 - share) * s.g[0] + share * s.g[1], size_of_g_);
}

StepSources::Parabolas::Parabolas(Index width, Index most) : size(Vector::Zero(width)) {
  for (Matrix& c : coefficients) c.resize(width, most);
  for (Vector& v : values) v.resize(width);
}

bool StepSources::Parabolas::add(const TimeFunction& source, double from, double to, Index step, double resolved) {
  const std::array<double, 4> places{gauss_points[0], gauss_points[1], gauss_points[2], one_place};
  for (std::size_t k = 0; k < 4; ++k) {
    values[k].setZero();
    source(from + places[k] * (to - from), values[k]);
    size = size.cwiseMax(values[k].cwiseAbs());
  }
  for (Index i = 0; i < size.size(); ++i) {
    const std::array<double, 3> c = gauss_parabola<double>({values[0][i], values[1][i], values[2][i]});
    if (!(std::abs(c[0] + one_place * (c[1] + one_place * c[2]) - values[3][i]) <= resolved * size[i])) return false;
    for (std::size_t k = 0; k < 3; ++k) coefficients[k](i, step) = c[k];
  }
  return true;
}

// What a parabola of the step misses, that of a part misses by `division`^-3 of it.
StepSources::StepSources(const Scene& scene, Index division, Index most_steps)
    : scene_(scene),
      resolved_(resolved / std::pow(double(division), 3)),
      f_(scene.f ? scene.sources() : 0, most_steps),
      g_(scene.g ? scene.constraints() : 0, most_steps) {
  if (scene.f && scene.f_entry != SourceEntry::state) F_ = source_matrix(scene, *scene.dynamics->small_state());
}

bool StepSources::add(double from, double to) {
  if (scene_.f && !f_.add(scene_.f, from, to, steps_, resolved_)) return false;
  if (scene_.g && !g_.add(scene_.g, from, to, steps_, resolved_)) return false;
  ++steps_;
  return true;
}

Matrix StepSources::f(std::size_t k) const {
  const auto phi = f_.coefficients[k].leftCols(steps_).transpose();
  return F_.size() > 0 ? Matrix(phi * F_.transpose()) : Matrix(phi);
}

}  // namespace bromwich
