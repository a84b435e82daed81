#include "core/certificate/part_sources.hpp"

#include "core/certificate/part_weights.hpp"

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
    const double off = std::sqrt(0.15);  // Gauss points 1/2 and 1/2 ± off
    const Vector a = sources_.f(p.from + (0.5 - off) * d), b = sources_.f(p.from + 0.5 * d),
                 c = sources_.f(p.from + (0.5 + off) * d);
    const Vector slope = (c - a) / (2 * off), bend = (a - 2 * b + c) / (2 * off * off);
    s.f = {b - slope / 2 + bend / 4, slope - bend, bend};
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

}  // namespace bromwich
