#include "core/certificate/parts.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace bromwich {

namespace {

constexpr Index units = Index(1 / shortest_part);
constexpr double same_time = 1e-12;  ///< of T

// A breakpoint inside a step or at its left end: in units from there, and its own time.
struct Mark {
  Index unit;
  double time;
};

class StepParts {
 public:
  StepParts(Index step, double begin, double end, double length, Index division, std::vector<Part>& parts)
      : step_(step), begin_(begin), end_(end), length_(length), units_(division * units), parts_(parts) {}

  // Between two marks, or the ends of the step. `layer`: parts behind `left` begin short.
  void fill(const Mark& left, const Mark& right, bool layer) {
    const double scale = (right.time - left.time) / double(right.unit - left.unit);
    const auto time = [&](Index unit) {
      return unit == right.unit ? right.time : left.time + scale * double(unit - left.unit);
    };
    for (Index at = left.unit; at < right.unit;) {
      Index length = at == 0 ? units : std::min(units, at & -at);
      while (at + length > right.unit || (layer && length > std::max<Index>(1, at - left.unit))) length /= 2;
      const double whole = double(units_);
      parts_.push_back({step_, double(at) / whole, double(at + length) / whole, length_ * double(length) / whole,
                        time(at), time(at + length)});
      at += length;
    }
  }

  Index unit_of(double t, Index after) const {
    return std::clamp<Index>(std::llround((t - begin_) / (end_ - begin_) * double(units_)), after, units_ - 1);
  }
  Index last() const { return units_; }

 private:
  Index step_;
  double begin_, end_, length_;
  Index units_;
  std::vector<Part>& parts_;
};

}  // namespace

std::array<Part, 2> halves(const Part& whole) {
  Part first = whole, second = whole;
  first.length = second.length = whole.length / 2;
  first.end = second.begin = (whole.begin + whole.end) / 2;
  first.to = second.from = (whole.from + whole.to) / 2;
  return {first, second};
}

std::vector<Part> divide(const Vector& t, const std::vector<double>& breakpoints, Index division,
                         const std::vector<double>& marks) {
  std::vector<Part> parts;
  const Index J = t.size() - 1;
  const double near = same_time * (t[J] - t[0]), length = (t[J] - t[0]) / double(J);
  std::map<double, bool> ends;  // whether a layer begins there
  for (const double mark : marks) ends[mark] = false;
  for (const double b : breakpoints) ends[b] = true;
  auto next = ends.begin();
  bool jumped = true;  // t = 0: x0 may be off the constraints
  for (Index j = 1; j <= J; ++j) {
    StepParts step(j, t[j - 1], t[j], length, division, parts);
    Mark left{0, t[j - 1]};
    for (; next != ends.end() && next->first <= t[j - 1] + near; ++next) jumped = jumped || next->second;
    for (; next != ends.end() && next->first < t[j] - near; ++next) {
      if (left.unit + 1 >= step.last() - 1) continue;
      const Mark mark{step.unit_of(next->first, left.unit + 1), next->first};
      step.fill(left, mark, jumped);
      left = mark;
      jumped = next->second;
    }
    step.fill(left, {step.last(), t[j]}, jumped);
    jumped = false;
  }
  return parts;
}

}  // namespace bromwich
