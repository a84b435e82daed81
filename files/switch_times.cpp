#include "files/switch_times.hpp"

#include "files/course.hpp"

#include "core/base/types.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace bromwich {

namespace {

/// A condition that is not a comparison is false if it is 0 over the whole piece.
bool vanishes(const Course& c) { return c.left == 0 && c.right == 0; }

/// The expression over pieces of [0, T].
class Search {
 public:
  Search(const Formula& formula, double T, long& work) : formula_(formula), T_(T), work_(work), given_(work) {}

  SwitchTimes run() {
    std::vector<std::pair<double, double>> pieces{{0, T_}};
    while (!pieces.empty()) {
      const auto [a, b] = pieces.back();
      pieces.pop_back();
      if (work_ <= 0 || hopeless(a)) {
        found_.complete = false;
        break;
      }
      const double closest = std::max(8 * epsilon * b, 1e-15 * T_);
      if (b - a <= closest) continue;
      switch (look(a, b)) {
        case Outcome::smooth:
          break;
        case Outcome::switches: {
          const auto [before, behind] = locate(a, b);
          found_.times.push_back(behind);
          pieces.emplace_back(behind, b);
          pieces.emplace_back(a, before);
          break;
        }
        case Outcome::open:
          if (b - a <= 1e-13 * T_) break;  // both ends have the same way
          pieces.emplace_back(a + (b - a) / 2, b);
          pieces.emplace_back(a, a + (b - a) / 2);
      }
    }
    clean();
    return std::move(found_);
  }

 private:
  enum class Outcome { smooth, switches, open };

  /// Whether the work so far shows that [0, T] would take ten times all of it: pieces are searched from left to right.
  bool hopeless(double reached) const {
    const double used = double(given_ - work_), all = double(given_);
    return used > all / 16 && used / 10 > all * (reached / T_);
  }

  /// Courses over [a, b]; stops at an operation that is not smooth there.
  struct Courses {
    Search& search;
    double a, b;
    Outcome outcome = Outcome::smooth;

    static Course constant(double value) { return bromwich::constant(value); }
    Course time() const { return {a, b, {a, b}, {1, 1}}; }
    static bool zero(const Course& c) { return vanishes(c); }
    std::optional<Course> apply(Operation o, const Course& first, const Course& second) {
      --search.work_;
      const double width = b - a;
      if (!switches(o))
        return takes_two(o) ? bromwich::apply(o, first, second, width) : bromwich::apply(o, first, width);
      outcome = search.decide(o, first, second, width);
      if (outcome != Outcome::smooth) return std::nullopt;
      return apply_on(o, search.ways_.back(), first, second, width);
    }
  };

  /// Numbers at one time, on the ways of the last run over a piece; stops at the operation at which that stopped.
  struct Values {
    Search& search;
    double t;
    std::size_t known = 0;
    std::pair<double, bool> stopped = {0, true};  ///< s there, and whether its way is low_way_ or below

    static double constant(double value) { return value; }
    double time() const { return t; }
    static bool zero(double value) { return value == 0; }
    std::optional<double> apply(Operation o, double a, double b) {
      --search.work_;
      if (!switches(o)) return takes_two(o) ? bromwich::apply(o, a, b) : bromwich::apply(o, a);
      if (known < search.ways_.size()) return apply_on(o, search.ways_[known++], a, b);
      stopped = {switching(o, a, b), way_of(o, a, b) <= search.low_way_};
      return std::nullopt;
    }
  };

  /// Runs the program over [a, b]; ways_ are those of the operations that switch, in the order of execution. If one has
  /// different ways at the ends, `low_way_` is the way below the change to be located.
  Outcome look(double a, double b) {
    ways_.clear();
    Courses courses{*this, a, b};
    execute(formula_, courses, stack_);
    return courses.outcome;
  }

  Outcome decide(Operation o, const Course& first, const Course& second, double width) {
    const double at_left = way_of(o, first.left, second.left), at_right = way_of(o, first.right, second.right);
    const double s_left = switching(o, first.left, second.left), s_right = switching(o, first.right, second.right);
    if (std::isnan(s_left) && std::isnan(s_right)) return keep(at_left);
    if (std::isnan(s_left) || std::isnan(s_right)) return Outcome::open;
    // atan2 jumps only on the negative axis of its second argument.
    if (o == Operation::atan2 && second.value.low >= 0) return keep(at_left);
    if (o == Operation::atan2 && second.value.high > 0 && at_left != at_right) return Outcome::open;
    if (at_left != at_right) {
      target_ = o;
      low_way_ = std::floor((at_left + at_right) / 2);
      return Outcome::switches;
    }
    const Course s = switching(o, first, second, width);
    if (one_way(o, s.value) || s.slope.low >= 0 || s.slope.high <= 0) return keep(at_left);
    return Outcome::open;
  }

  Outcome keep(double way) {
    ways_.push_back(way);
    return Outcome::smooth;
  }

  /// s of the operation at which `look` stopped, and whether its way is low_way_ or below, at one time.
  std::pair<double, bool> at(double t) {
    Values values{*this, t};
    execute(formula_, values, values_);
    return values.stopped;
  }

  /// Adjacent floating-point numbers in [a, b] between which the way changes.
  std::pair<double, double> locate(double a, double b) {
    auto left = at(a), right = at(b);
    const double wanted = end_of(target_, low_way_);
    const auto move = [&](double t) {
      if (!(t > a && t < b)) return;
      const auto found = at(t);
      const bool beside_a = found.second == left.second;
      (beside_a ? a : b) = t;
      (beside_a ? left : right).first = found.first;
    };
    while (b - a > 1e-17 * T_ && std::nextafter(a, b) < b && work_ > 0) {
      const double before = b - a;
      const double secant = a + before * ((wanted - left.first) / (right.first - left.first));
      const double margin = std::max(before / 1024, 2 * epsilon * b);
      if (std::isfinite(secant)) {
        move(secant - margin);
        move(secant + margin);
      }
      if (b - a > before / 4) move(a + (b - a) / 2);
    }
    return {a, b};
  }

  /// Times that differ only by rounding are replaced by the last of them.
  void clean() {
    const double same = 16 * epsilon * T_;
    std::vector<double> kept;
    std::sort(found_.times.begin(), found_.times.end());
    for (double t : found_.times) {
      if (t <= same) t = 0;
      if (t >= T_ - same) t = T_;
      if (!kept.empty() && t - kept.back() <= same)
        kept.back() = t;
      else
        kept.push_back(t);
    }
    found_.times = std::move(kept);
  }

  const Formula& formula_;
  double T_;
  long& work_;
  long given_;
  Operation target_ = Operation::constant;
  double low_way_ = 0;
  std::vector<double> ways_, values_;
  std::vector<Course> stack_;
  SwitchTimes found_;
};

}  // namespace

SwitchTimes switch_times(const Formula& formula, double T, long& work) {
  if (!formula.switches) return {};
  return Search(formula, T, work).run();
}

}  // namespace bromwich
