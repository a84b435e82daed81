#include "core/adapted/steps_between.hpp"

#include "core/lcp/lcp_class.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double parts_of_step = 8;
constexpr double same_time = 1e-12;  ///< of T

}  // namespace

StepsBetween::StepsBetween(const Scene& scene, double h)
    : scene_(scene), h_(h), same_time_(same_time * scene.T), steps_(scene, known_class(scene.M, scene.lcp_class)) {}

bool StepsBetween::breaks_in(double from, double until) const {
  const std::vector<double>& breaks = scene_.breakpoints;
  const auto next = std::lower_bound(breaks.begin(), breaks.end(), from - same_time_);
  return next != breaks.end() && *next <= until + same_time_;
}

// From one end, breakpoint or asked time to the next, in steps of equal length, or of doubled ones behind a jump.
bool StepsBetween::pass(double a, double b, bool layer) {
  const double length = b - a, most = layer ? h_ / parts_of_step / length : 1 / std::ceil(length / h_ * parts_of_step);
  for (double begin = 0; begin < 1;) {
    const double wanted = !layer ? begin + most : begin == 0 ? shortest_part : std::min(2 * begin, begin + most);
    const double end = wanted > 1 - shortest_part ? 1 : wanted;
    Part part;
    part.begin = begin;
    part.end = end;
    part.length = (layer ? end - begin : most) * length;
    part.from = a + begin * length;
    part.to = end == 1 ? b : a + end * length;
    TreeRow to;
    if (!steps_.take(part, row_, to)) return false;
    row_ = std::move(to);
    begin = end;
  }
  return true;
}

const TreeRow* StepsBetween::at(double begin, const Vector& x, const Vector& y, double s) {
  const double end = begin + s;
  if (begin_ != begin || end < t_) {
    row_ = {x, y.allFinite() ? y : Vector(Vector::Zero(y.size())), Vector::Zero(y.size())};
    begin_ = t_ = begin;
  }
  const std::vector<double>& breaks = scene_.breakpoints;
  while (end - t_ > same_time_) {
    const auto next = std::upper_bound(breaks.begin(), breaks.end(), t_ + same_time_);
    const double stop = next != breaks.end() && *next < end - same_time_ ? *next : end;
    if (!pass(t_, stop, t_ == begin ? begin == 0 || breaks_in(begin - h_, begin) : breaks_in(t_, t_))) {
      begin_ = NAN;
      return nullptr;
    }
    t_ = stop;
  }
  return &row_;
}

}  // namespace bromwich
