#include "core/march/dyadic_parts.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr int octaves = 18;
constexpr Index units = Index(1) << octaves;    ///< of a step
constexpr Index coarse_units = Index(1) << 10;  ///< of a step, to which kinks and predicted times are rounded
constexpr double same_value = 1e-9;             ///< of the largest: values that count as equal
constexpr Index most_divisions = 5;             ///< q: Radau IIA errs by 2^-4q / 72 in a part of a layer
constexpr Index usual_divisions = 2;            ///< the least on given steps, but where jumps are as many as these

Vector size_of(const SampledSource& samples) {
  const Vector size = samples.values().cwiseAbs().colwise().maxCoeff().transpose();
  return size.cwiseMax(1e-12 * (size.size() > 0 ? size.maxCoeff() : 0)).cwiseMax(1e-290);
}

bool differ(const Vector& a, const Vector& b, const Vector& size) {
  return ((a - b).cwiseAbs().array() > same_value * size.array()).any();
}

Index floor_log2(Index value) {
  Index power = 0;
  while (value >>= 1) ++power;
  return power;
}

}  // namespace

DyadicParts::DyadicParts(const DiscreteProblem& p, bool from_start, bool compares_grids)
    : p_(p), last_(from_start ? 0 : -1) {
  const double resolution = p.sources ? p.sources->resolution : 256 * epsilon * p.scene.T;
  if (p.scene.f && p.f.size() > 0) {
    f_.emplace(p.scene.f, p.scene.sources(), resolution);
    f_size_ = size_of(p.f);
  }
  if (p.scene.g) {
    g_.emplace(p.scene.g, p.scene.constraints(), resolution);
    g_size_ = size_of(p.g);
  }
  Index layers = 1;
  for (const RoughStep& rough : p.sources ? p.sources->rough : std::vector<RoughStep>()) {
    Division& d = divided_[rough.step] = divide(rough);
    layers += Index(d.jumps.size());
    const double end = p.t[rough.step];
    if (rough.step < p.J && jumps(end, end, p.h)) divided_[rough.step + 1];
  }
  // More parts on finer grids, whose errors are seen by comparing them: with every second halving of the step.
  if (layers < p.J) q_ = 1 + floor_log2(p.J / layers) / 2;
  q_ = std::clamp(q_, compares_grids || layers >= p.J ? 0 : usual_divisions, most_divisions);
}

std::vector<DyadicPart> DyadicParts::of(Index step, const std::vector<double>& more, bool brief_at_end) {
  const double begin = p_.t[step - 1], end = p_.t[step];
  const auto found = divided_.find(step);
  const Division none, &division = found != divided_.end() ? found->second : none;
  if (step > 1 && found != divided_.end() && jumps(begin, begin, p_.h)) last_ = (step - 1) * units;
  std::vector<Index> cuts = division.kinks;
  for (const double t : more)
    cuts.push_back(std::clamp<Index>(std::llround((t - begin) / p_.h * double(coarse_units)), 0, coarse_units) *
                   (units / coarse_units));
  if (brief_at_end) cuts.insert(cuts.end(), {units - 2, units - 1});
  std::sort(cuts.begin(), cuts.end());
  std::vector<DyadicPart> parts;
  Jump left{0, begin, begin};
  for (const Jump& jump : division.jumps) {
    add_parts(step, left, jump, cuts, parts);
    left = jump;
    last_ = (step - 1) * units + jump.unit;
  }
  add_parts(step, left, {units, end, end}, cuts, parts);
  return parts;
}

// The parts between two jumps, or the ends of the step.
void DyadicParts::add_parts(Index step, const Jump& left, const Jump& right, const std::vector<Index>& cuts,
                            std::vector<DyadicPart>& parts) {
  const double scale = (right.before - left.after) / double(right.unit - left.unit);
  const auto looked_at = [&](Index unit) {
    return unit == right.unit ? right.before : left.after + scale * double(unit - left.unit);
  };
  auto cut = std::upper_bound(cuts.begin(), cuts.end(), left.unit);
  for (Index at = left.unit; at < right.unit;) {
    const Index end = cut != cuts.end() ? std::min(*cut, right.unit) : right.unit;
    Index length = at == 0 ? units : at & -at;
    while (at + length > end) length /= 2;
    const Index behind = last_ < 0 ? units << q_ : (step - 1) * units + at - last_;
    while (length > std::max<Index>(1, behind >> q_)) length /= 2;
    const double time = at + length == units ? p_.t[step] : p_.t[step - 1] + p_.h * double(at + length) / double(units);
    parts.push_back({time, p_.h * double(length) / double(units), looked_at(at), looked_at(at + length)});
    at += length;
    while (cut != cuts.end() && *cut <= at) ++cut;
  }
}

DyadicParts::Division DyadicParts::divide(const RoughStep& rough) const {
  const double begin = p_.t[rough.step - 1], unit = p_.h / double(units);
  const std::vector<double> ends(rough.ends.begin(), rough.ends.end() - 1);
  Division d;
  for (std::size_t first = 0; first < ends.size();) {
    std::size_t last = first;
    while (last + 1 < ends.size() && ends[last + 1] - ends[last] < unit) ++last;
    add(ends, first, last, begin, d);
    first = last + 1;
  }
  for (std::size_t k = d.jumps.size(); k-- > 0;) {
    const Index next = k + 1 < d.jumps.size() ? d.jumps[k + 1].unit : units;
    d.jumps[k].unit = std::min(d.jumps[k].unit, next - 1);
  }
  return d;
}

// One jump for ends within a unit, or two where g returns between them: a pulse, however short, may move the state.
void DyadicParts::add(const std::vector<double>& ends, std::size_t first, std::size_t last, double begin,
                      Division& d) const {
  const double length = p_.h / double(units);
  const auto unit_of = [&](double t) {
    const Index after = d.jumps.empty() ? 1 : d.jumps.back().unit + 1;
    return std::max(Index(std::llround((t - begin) / length)), after);
  };
  if (last > first && returns(ends, first, last)) {
    d.jumps.push_back({unit_of(ends[first]), ends[first], ends[first]});
    d.jumps.push_back({unit_of(ends[last]), ends[last], ends[last]});
  } else if (jumps(ends[first], ends[last], length)) {
    d.jumps.push_back({unit_of(ends[first]), ends[first], ends[last]});
  } else {
    const Index place = std::llround((ends[first] - begin) / p_.h * double(coarse_units));
    d.kinks.push_back(place * (units / coarse_units));
  }
}

// Whether g between these ends leaves the range of its limits on both sides.
bool DyadicParts::returns(const std::vector<double>& ends, std::size_t first, std::size_t last) const {
  if (!g_) return false;
  const double unit = p_.h / double(units);
  const Vector a = g_->before(ends[first], unit), b = g_->after(ends[last], unit);
  const Vector low = a.cwiseMin(b) - same_value * g_size_, high = a.cwiseMax(b) + same_value * g_size_;
  const auto outside = [&](const Vector& v) {
    return (v.array() < low.array()).any() || (v.array() > high.array()).any();
  };
  for (std::size_t k = first; k < last; ++k) {
    const double d = ends[k + 1] - ends[k];
    if (outside(g_->after(ends[k], d)) || outside(g_->before(ends[k + 1], d))) return true;
  }
  return false;
}

// Between the limits on both sides of these times.
bool DyadicParts::jumps(double begin, double end, double length) const {
  return (f_ && differ(f_->before(begin, length), f_->after(end, length), f_size_)) ||
         (g_ && differ(g_->before(begin, length), g_->after(end, length), g_size_));
}

}  // namespace bromwich
