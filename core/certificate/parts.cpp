#include "core/certificate/parts.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index units = Index(1 / shortest_part);
constexpr double same_time = 1e-12;  ///< of T

// A breakpoint inside a step or at its left end: in units from there, and its own time.
struct Mark {
  Index unit;
  double time;
};

class Division {
 public:
  Division(Index step, double begin, double end, double length, Index division, std::vector<Part>& parts)
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

StepParts::StepParts(const Vector& t, const std::vector<double>& breakpoints, Index division,
                     const std::vector<double>& marks)
    : t_(t), division_(division) {
  const Index J = t.size() - 1;
  near_ = same_time * (t[J] - t[0]);
  length_ = (t[J] - t[0]) / double(J);
  for (const double mark : marks) ends_[mark] = false;
  for (const double b : breakpoints) ends_[b] = true;
  next_ = ends_.begin();
}

bool StepParts::next_is_plain() const { return !jumped_ && (next_ == ends_.end() || next_->first >= t_[j_] - near_); }

void StepParts::pass(std::vector<Part>* wanted) {
  const Index j = j_++;
  for (; next_ != ends_.end() && next_->first <= t_[j - 1] + near_; ++next_) jumped_ = jumped_ || next_->second;
  std::vector<Part> ignored;
  Division step(j, t_[j - 1], t_[j], length_, division_, wanted ? *wanted : ignored);
  Mark left{0, t_[j - 1]};
  for (; next_ != ends_.end() && next_->first < t_[j] - near_; ++next_) {
    if (left.unit + 1 >= step.last() - 1) continue;
    const Mark mark{step.unit_of(next_->first, left.unit + 1), next_->first};
    step.fill(left, mark, jumped_);
    left = mark;
    jumped_ = next_->second;
  }
  if (wanted) step.fill(left, {step.last(), t_[j]}, jumped_);
  jumped_ = false;
}

std::vector<Part> divide(const Vector& t, const std::vector<double>& breakpoints, Index division,
                         const std::vector<double>& marks) {
  std::vector<Part> parts;
  StepParts steps(t, breakpoints, division, marks);
  for (Index j = 1; j < t.size(); ++j) steps.pass(&parts);
  return parts;
}

}  // namespace bromwich
