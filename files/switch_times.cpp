#include "files/switch_times.hpp"

#include "files/range.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace bromwich {

namespace {

constexpr double eps = std::numeric_limits<double>::epsilon();
constexpr double inf = std::numeric_limits<double>::infinity();

/// A value over a piece [a, b] of time.
struct Course {
  double left = 0, right = 0;  ///< at a and at b
  Range value, slope;
};

Course constant(double c) { return {c, c, {c, c}, {0, 0}}; }

/// A condition that is no comparison is false where it is 0 over the whole piece.
bool vanishes(const Course& c) { return c.left == 0 && c.right == 0; }

bool compares(Operation o) { return o >= Operation::less && o <= Operation::not_equal; }
bool in_whole_numbers(Operation o) {
  return o == Operation::floor || o == Operation::ceil || o == Operation::round || o == Operation::mod;
}
bool switches(Operation o) {
  return compares(o) || in_whole_numbers(o) || o == Operation::abs || o == Operation::sign ||
         o == Operation::heaviside || o == Operation::cbrt || o == Operation::minimum || o == Operation::maximum ||
         o == Operation::atan2;
}

/// s of an operation.
template <class Value>
Value switching(Operation o, const Value& a, const Value& b) {
  if (compares(o) || o == Operation::minimum || o == Operation::maximum) return a - b;
  return o == Operation::mod ? a / b : a;
}

/// Which way the operation goes, a number that grows with s.
double branch(Operation o, double a, double b) {
  switch (o) {
    case Operation::less:
    case Operation::minimum:
      return double(!(a < b));
    case Operation::less_equal:
      return double(!(a <= b));
    case Operation::greater:
    case Operation::maximum:
      return double(a > b);
    case Operation::greater_equal:
      return double(a >= b);
    case Operation::equal:
    case Operation::not_equal:
      return double(a > b) - double(a < b);
    case Operation::mod:
      return std::floor(a / b);
    case Operation::abs:
    case Operation::heaviside:
    case Operation::cbrt:
    case Operation::atan2:
      return double(a >= 0);
    default:
      return apply(o, a);  // sign, floor, ceil, round
  }
}

/// The value of an operation that goes the way `way`.
double apply_on(Operation o, double way, double a, double b) {
  switch (o) {
    case Operation::less:
    case Operation::less_equal:
      return double(way == 0);
    case Operation::equal:
      return double(way == 0);
    case Operation::not_equal:
      return double(way != 0);
    case Operation::minimum:
      return way == 0 ? a : b;
    case Operation::maximum:
      return way == 0 ? b : a;
    case Operation::mod:
      return a - b * way;
    case Operation::abs:
      return way == 0 ? -a : a;
    case Operation::cbrt:
      return std::cbrt(a);
    case Operation::atan2:
      return std::atan2(a, b);
    default:
      return way;
  }
}

/// s at which a way changes to the next one.
double level(Operation o, double way) {
  if (o == Operation::floor || o == Operation::mod) return way + 1;
  if (o == Operation::round) return way + 0.5;
  return o == Operation::ceil ? way : 0;
}

/// Whether s of this range goes one way throughout.
bool one_way(Operation o, Range s) {
  if (!in_whole_numbers(o)) return s.low > 0 || s.high < 0;
  const auto whole = [&](double value) { return o == Operation::mod ? std::floor(value) : apply(o, value); };
  return whole(s.low) == whole(s.high);
}

/// Range and slope of a smooth function of one argument.
std::pair<Range, Range> smooth(Operation o, Range a) {
  const Range one{1, 1};
  const auto map = [&](double (*f)(double)) { return increasing(f, a); };
  switch (o) {
    case Operation::sin:
      return {range_sin(a), range_cos(a)};
    case Operation::cos:
      return {range_cos(a), -range_sin(a)};
    case Operation::tan: {
      const Range value = range_tan(a);
      return {value, one + range_square(value)};
    }
    case Operation::asin:
    case Operation::acos: {
      const Range inside{std::max(a.low, -1.0), std::min(a.high, 1.0)};
      const Range left = one - range_square(inside);
      const Range slope{1 / std::sqrt(std::max(left.high, 1e-300)), left.low > 0 ? 1 / std::sqrt(left.low) : inf};
      const Range value = increasing([](double s) { return std::asin(s); }, inside);
      if (o == Operation::asin) return {value, widened(slope)};
      return {increasing([](double s) { return -std::acos(s); }, inside), widened(slope)};
    }
    case Operation::atan:
      return {map([](double s) { return std::atan(s); }), one / (one + range_square(a))};
    case Operation::sinh:
      return {map([](double s) { return std::sinh(s); }), range_cosh(a)};
    case Operation::cosh:
      return {range_cosh(a), map([](double s) { return std::sinh(s); })};
    case Operation::tanh: {
      const Range c = range_cosh(a);
      return {map([](double s) { return std::tanh(s); }), one / range_square(c)};
    }
    case Operation::exp:
      return {map([](double s) { return std::exp(s); }), map([](double s) { return std::exp(s); })};
    case Operation::expm1:
      return {map([](double s) { return std::expm1(s); }), map([](double s) { return std::exp(s); })};
    case Operation::log:
    case Operation::log10:
    case Operation::log2: {
      if (!(a.low > 0)) return {};
      const double unit = o == Operation::log ? 1 : o == Operation::log10 ? std::log(10.) : std::log(2.);
      const Range per{unit, unit};
      return {map([](double s) { return std::log(s); }) / per, one / (a * per)};
    }
    case Operation::sqrt: {
      const Range inside{std::max(a.low, 0.0), a.high};
      if (!(a.high >= 0)) return {};
      const Range value = increasing([](double s) { return std::sqrt(s); }, inside);
      return {value, {0.5 / value.high * (1 - 8 * eps), value.low > 0 ? 0.5 / value.low * (1 + 8 * eps) : inf}};
    }
    case Operation::erf:
    case Operation::erfc: {
      // 2 / sqrt(pi) exp(-a^2)
      const Range bell = increasing([](double s) { return 1.1283791670955126 * std::exp(s); }, -range_square(a));
      if (o == Operation::erf) return {map([](double s) { return std::erf(s); }), bell};
      return {-increasing([](double s) { return -std::erfc(s); }, a), -bell};
    }
    default:
      return {};
  }
}

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
      const double closest = std::max(8 * eps * b, 1e-15 * T_);
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
          if (b - a <= 1e-13 * T_) break;  // both ends go the same way
          pieces.emplace_back(a + (b - a) / 2, b);
          pieces.emplace_back(a, a + (b - a) / 2);
      }
    }
    clean();
    return std::move(found_);
  }

 private:
  enum class Outcome { smooth, switches, open };

  /// A part of the work shows that [0, T] takes ten times all of it: time goes by from left to right.
  bool hopeless(double reached) const {
    const double used = double(given_ - work_), all = double(given_);
    return used > all / 16 && used / 10 > all * (reached / T_);
  }

  /// Runs the program over [a, b]; ways_ are those of the operations that switch, in the order of execution. Where the
  /// ends of one go different ways, `low_way_` is the way below the change that is looked for.
  Outcome look(double a, double b) {
    ways_.clear();
    stack_.clear();
    width_ = b - a;
    const auto pop = [this] {
      const Course top = stack_.back();
      stack_.pop_back();
      return top;
    };
    const auto& program = formula_.program;
    for (std::size_t i = 0; i < program.size(); ++i) {
      const Instruction& step = program[i];
      --work_;
      switch (step.operation) {
        case Operation::constant:
          stack_.push_back(constant(step.value));
          break;
        case Operation::time:
          stack_.push_back({a, b, {a, b}, {1, 1}});
          break;
        case Operation::jump:
          i = step.target - 1;
          break;
        case Operation::jump_if_zero:
          if (vanishes(pop())) i = step.target - 1;
          break;
        case Operation::jump_if_not_zero:
          if (!vanishes(pop())) i = step.target - 1;
          break;
        case Operation::truth:
          stack_.push_back(constant(double(!vanishes(pop()))));
          break;
        default: {
          const bool two = takes_two(step.operation);
          const Course second = two ? pop() : Course{}, first = pop();
          if (!switches(step.operation)) {
            stack_.push_back(
                tightened(two ? smooth_of_two(step.operation, first, second) : smooth_of_one(step.operation, first)));
            break;
          }
          const Outcome outcome = decide(step.operation, first, second);
          if (outcome != Outcome::smooth) return outcome;
          stack_.push_back(tightened(on_its_way(step.operation, ways_.back(), first, second)));
        }
      }
    }
    return Outcome::smooth;
  }

  Outcome decide(Operation o, const Course& first, const Course& second) {
    const double at_left = branch(o, first.left, second.left), at_right = branch(o, first.right, second.right);
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
    const Course s = tightened(course_of_s(o, first, second, s_left, s_right));
    if (one_way(o, s.value) || s.slope.low >= 0 || s.slope.high <= 0) return keep(at_left);
    return Outcome::open;
  }

  Outcome keep(double way) {
    ways_.push_back(way);
    return Outcome::smooth;
  }

  static Course course_of_s(Operation o, const Course& first, const Course& second, double left, double right) {
    if (o == Operation::mod) {
      Course q = quotient(first, second);
      q.left = left;
      q.right = right;
      return q;
    }
    if (compares(o) || o == Operation::minimum || o == Operation::maximum)
      return {left, right, first.value - second.value, first.slope - second.slope};
    return first;
  }

  static Course quotient(const Course& a, const Course& b) {
    const Range value = a.value / b.value;
    return {a.left / b.left, a.right / b.right, value, (a.slope - value * b.slope) / b.value};
  }

  static Course on_its_way(Operation o, double way, const Course& a, const Course& b) {
    const Range whole{way, way};
    switch (o) {
      case Operation::minimum:
        return way == 0 ? a : b;
      case Operation::maximum:
        return way == 0 ? b : a;
      case Operation::abs:
        return way == 0 ? Course{-a.left, -a.right, -a.value, -a.slope} : a;
      case Operation::mod:
        return {a.left - b.left * way, a.right - b.right * way, a.value - b.value * whole, a.slope - b.slope * whole};
      case Operation::cbrt: {
        const Range value = increasing([](double s) { return std::cbrt(s); }, a.value);
        return {std::cbrt(a.left), std::cbrt(a.right), value, a.slope / (Range{3, 3} * range_square(value))};
      }
      case Operation::atan2:
        return {std::atan2(a.left, b.left), std::atan2(a.right, b.right),
                widened({-3.1415926535897936, 3.1415926535897936}),
                (b.value * a.slope - a.value * b.slope) / (range_square(a.value) + range_square(b.value))};
      default:
        return constant(apply_on(o, way, 0, 0));
    }
  }

  static Course smooth_of_one(Operation o, const Course& a) {
    if (o == Operation::negative) return {-a.left, -a.right, -a.value, -a.slope};
    if (o == Operation::acos) {
      const auto [value, slope] = smooth(o, a.value);
      return {std::acos(a.left), std::acos(a.right), -value, -slope * a.slope};
    }
    const auto [value, slope] = smooth(o, a.value);
    return {apply(o, a.left), apply(o, a.right), value, slope * a.slope};
  }

  static Course smooth_of_two(Operation o, const Course& a, const Course& b) {
    Course c{apply(o, a.left, b.left), apply(o, a.right, b.right), {}, {}};
    if (o == Operation::add) {
      c.value = a.value + b.value;
      c.slope = a.slope + b.slope;
    } else if (o == Operation::subtract) {
      c.value = a.value - b.value;
      c.slope = a.slope - b.slope;
    } else if (o == Operation::multiply) {
      c.value = a.value * b.value;
      c.slope = a.slope * b.value + a.value * b.slope;
    } else if (o == Operation::divide) {
      return quotient(a, b);
    } else if (o == Operation::power) {
      c.value = range_power(a.value, b.value);
      const bool fixed = b.slope.point() && b.slope.low == 0 && b.value.point();
      const Range one{1, 1};
      if (fixed)
        c.slope = b.value * range_power(a.value, b.value - one) * a.slope;
      else if (a.value.low > 0)
        c.slope = c.value *
                  (b.slope * increasing([](double s) { return std::log(s); }, a.value) + b.value * a.slope / a.value);
    }
    return c;
  }

  /// The mean value theorem from both ends.
  Course tightened(Course c) const {
    if (!std::isfinite(c.left) || !std::isfinite(c.right)) return {c.left, c.right, {}, {}};
    const double fall = c.slope.low * width_, rise = c.slope.high * width_;
    const Range from_left{c.left + std::min(0.0, fall), c.left + std::max(0.0, rise)};
    const Range from_right{c.right - std::max(0.0, rise), c.right - std::min(0.0, fall)};
    const Range both{std::max(from_left.low, from_right.low), std::min(from_left.high, from_right.high)};
    const Range ends{std::min(c.left, c.right), std::max(c.left, c.right)};
    const Range mean = widened(hull(both, ends));
    c.value = hull({std::max(c.value.low, mean.low), std::min(c.value.high, mean.high)}, ends);
    return c;
  }

  /// s of the operation that `look` stopped at, and whether it goes the way low_way_ or below, at one time.
  std::pair<double, bool> at(double t) {
    values_.clear();
    std::size_t known = 0;
    const auto pop = [this] {
      const double top = values_.back();
      values_.pop_back();
      return top;
    };
    const auto& program = formula_.program;
    for (std::size_t i = 0; i < program.size(); ++i) {
      const Instruction& step = program[i];
      --work_;
      switch (step.operation) {
        case Operation::constant:
          values_.push_back(step.value);
          break;
        case Operation::time:
          values_.push_back(t);
          break;
        case Operation::jump:
          i = step.target - 1;
          break;
        case Operation::jump_if_zero:
          if (pop() == 0) i = step.target - 1;
          break;
        case Operation::jump_if_not_zero:
          if (pop() != 0) i = step.target - 1;
          break;
        default: {
          const bool two = takes_two(step.operation);
          const double b = two ? pop() : 0, a = pop();
          if (!switches(step.operation))
            values_.push_back(two ? apply(step.operation, a, b) : apply(step.operation, a));
          else if (known == ways_.size())
            return {switching(step.operation, a, b), branch(step.operation, a, b) <= low_way_};
          else
            values_.push_back(apply_on(step.operation, ways_[known++], a, b));
        }
      }
    }
    return {0, true};
  }

  /// Neighbouring numbers in [a, b] between which the way changes.
  std::pair<double, double> locate(double a, double b) {
    auto [s_a, below_a] = at(a);
    auto [s_b, below_b] = at(b);
    const double wanted = level(target_, low_way_);
    const auto move = [&](double t) {
      if (!(t > a && t < b)) return;
      const auto [s, below] = at(t);
      (below == below_a ? a : b) = t;
      (below == below_a ? s_a : s_b) = s;
    };
    while (b - a > 1e-17 * T_ && std::nextafter(a, b) < b && work_ > 0) {
      const double before = b - a;
      const double secant = a + before * ((wanted - s_a) / (s_b - s_a));
      const double margin = std::max(before / 1024, 2 * eps * b);
      if (std::isfinite(secant)) {
        move(secant - margin);
        move(secant + margin);
      }
      if (b - a > before / 4) move(a + (b - a) / 2);
    }
    return {a, b};
  }

  /// Times that are one, but for rounding, become the last of them.
  void clean() {
    const double same = 16 * eps * T_;
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
  double width_ = 0;
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
