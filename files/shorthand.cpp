#include "files/shorthand.hpp"

#include "core/base/error.hpp"
#include "files/names.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace bromwich {

namespace {

constexpr std::size_t longest_meaning = 1'000'000;
constexpr const char* pulse_form =
    "write pulse(t, period, width), or pulse(t, low, high, delay, rise, fall, width, period)";
constexpr const char* pwl_form = "write pwl(t, t1, v1, t2, v2, ...) with at least two points";

struct Point {
  double t = 0, value = 0;
};

/// A number as part of an expression.
std::string literal(double value) { return value < 0 ? fmt::format("({})", value) : fmt::format("{}", value); }

/// Text that holds from a time on.
struct Piece {
  double start = 0;
  std::string text;
};

std::string line(const std::string& s, const Point& a, const Point& b) {
  if (a.value == b.value) return literal(a.value);
  return fmt::format("({}+{}*({}-{}))", literal(a.value), literal((b.value - a.value) / (b.t - a.t)), s, literal(a.t));
}

/// The first piece holds before the first point as well.
std::vector<Piece> pieces(const std::string& s, const std::vector<Point>& points) {
  std::vector<Piece> all{{points.front().t, literal(points.front().value)}};
  for (std::size_t k = 1; k < points.size(); ++k)
    if (points[k - 1].t < points[k].t) all.push_back({points[k - 1].t, line(s, points[k - 1], points[k])});
  all.push_back({points.back().t, literal(points.back().value)});
  return all;
}

/// The choice between pieces first..last-1, by halving.
std::string choice(const std::string& s, const std::vector<Piece>& all, std::size_t first, std::size_t last) {
  if (last - first == 1) return all[first].text;
  const std::size_t middle = first + (last - first) / 2;
  return fmt::format("({}<{}?{}:{})", s, literal(all[middle].start), choice(s, all, first, middle),
                     choice(s, all, middle, last));
}

class Speller {
 public:
  Speller(const Definitions& definitions, const std::function<double(const std::string&)>& number,
          const std::string& where)
      : definitions_(definitions), number_(number), where_(where) {}

  std::string meaning(const std::string& text) const {
    std::string result;
    std::size_t copied = 0;
    for (const Name& name : names_in(text)) {
      if (name.begin < copied) continue;  // part of a call that is replaced
      const auto definition = definitions_.find(name.text);
      const bool function = name.called && (name.text == "pulse" || name.text == "pwl");
      if (!function && (name.called || definition == definitions_.end())) continue;
      result.append(text, copied, name.begin - copied);
      copied = name.begin + name.text.size();
      if (function) {
        const std::vector<std::string> arguments = call(text, copied);
        result += name.text == "pwl" ? pwl(arguments) : pulse(arguments);
      } else {
        result += "(" + definition->second + ")";
      }
      check_length(result);
    }
    result.append(text, copied);
    check_length(result);
    return result;
  }

 private:
  void check_length(const std::string& text) const {
    if (text.size() > longest_meaning)
      throw Error(where_,
                  fmt::format("the expression has more than {} characters with its definitions", longest_meaning),
                  "use fewer definitions within definitions, or a table .csv");
  }

  /// The arguments of the call whose parenthesis follows `place`, which moves behind it.
  std::vector<std::string> call(const std::string& text, std::size_t& place) const {
    std::vector<std::string> arguments;
    std::size_t begin = text.find('(', place) + 1;
    int depth = 1;
    for (std::size_t i = begin; i < text.size(); ++i) {
      depth += int(text[i] == '(') - int(text[i] == ')');
      if (depth > 1 || (depth == 1 && text[i] != ',')) continue;
      arguments.push_back(meaning(text.substr(begin, i - begin)));
      begin = i + 1;
      if (depth > 0) continue;
      place = begin;
      return arguments;
    }
    throw Error(where_, in_quotes(text) + " is no expression: a parenthesis is not closed", "correct it");
  }

  std::string pwl(const std::vector<std::string>& arguments) const {
    if (arguments.size() < 5 || arguments.size() % 2 == 0)
      throw Error(where_, fmt::format("pwl has {} arguments", arguments.size()), pwl_form);
    std::vector<Point> points;
    for (std::size_t k = 1; k < arguments.size(); k += 2)
      points.push_back({number_(arguments[k]), number_(arguments[k + 1])});
    return through(points, "(" + arguments[0] + ")");
  }

  std::string through(const std::vector<Point>& points, const std::string& s) const {
    for (std::size_t k = 1; k < points.size(); ++k) {
      if (points[k].t < points[k - 1].t)
        throw Error(where_, fmt::format("in pwl the time {} follows {}", points[k].t, points[k - 1].t),
                    "give ascending times");
      if (k > 1 && points[k].t == points[k - 2].t)
        throw Error(where_, fmt::format("in pwl the time {} is given three times", points[k].t),
                    "give the values before and behind a jump, two points");
    }
    const std::vector<Piece> all = pieces(s, points);
    return choice(s, all, 0, all.size());
  }

  std::string pulse(const std::vector<std::string>& arguments) const {
    const std::size_t count = arguments.size();
    if (count != 3 && count != 8) throw Error(where_, fmt::format("pulse has {} arguments", count), pulse_form);
    const double period = number_(arguments[count == 3 ? 1 : 7]);
    if (!(period > 0)) throw Error(where_, fmt::format("the period of pulse is {}", period), "give a positive one");
    const std::string s = "(" + arguments[0] + ")";
    if (count == 3) return fmt::format("(mod({},{})<({}))", s, literal(period), arguments[2]);
    std::array<double, 6> value{};  // low, high, delay, rise, fall, width
    std::transform(arguments.begin() + 1, arguments.begin() + 7, value.begin(), number_);
    const auto [low, high, delay, rise, fall, width] = value;
    if (rise < 0 || fall < 0 || width < 0 || rise + width + fall > period * (1 + 1e-12))
      throw Error(
          where_,
          fmt::format("pulse rises for {}, stays for {} and falls for {} in a period of {}", rise, width, fall, period),
          "give times from 0 on that are at most the period together");
    const std::vector<Point> points{{0, low}, {rise, high}, {rise + width, high}, {rise + width + fall, low}};
    const std::string since = fmt::format("({}-{})", s, literal(delay));
    return fmt::format("({}<0?{}:{})", since, literal(low),
                       through(distinct(points), fmt::format("mod({},{})", since, literal(period))));
  }

  /// Without a middle one of three points at one time, which no value of s reaches.
  static std::vector<Point> distinct(const std::vector<Point>& points) {
    std::vector<Point> kept;
    for (const Point& point : points) {
      if (kept.size() > 1 && kept[kept.size() - 2].t == point.t) kept.pop_back();
      kept.push_back(point);
    }
    return kept;
  }

  const Definitions& definitions_;
  const std::function<double(const std::string&)>& number_;
  const std::string& where_;
};

}  // namespace

std::vector<std::string> shorthand_functions() { return {"pulse", "pwl"}; }

std::string spelled_out(const std::string& text, const Definitions& definitions,
                        const std::function<double(const std::string&)>& number, const std::string& where) {
  return Speller(definitions, number, where).meaning(text);
}

}  // namespace bromwich
