#include "circuits/gates.hpp"

#include "core/base/error.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich::circuits {

namespace {

constexpr double looks = 64;  ///< a period of a source that is not piecewise linear

double value(const Control& c, double t) {
  double v = c.constant;
  for (const auto& [source, factor] : c.sources) v += factor * source->value(t);
  return v;
}

double slope(const Control& c, double t) {
  double v = 0;
  for (const auto& [source, factor] : c.sources) v += factor * source->slope(t);
  return v;
}

// The length of looks: infinite where all sources are piecewise linear.
double look_length(const Control& c, double T) {
  double length = INFINITY;
  for (const auto& [source, factor] : c.sources)
    if (!source->linear) length = std::min(length, (source->period > 0 ? source->period : T / 16) / looks);
  return length;
}

class Search {
 public:
  Search(const Control& control, double close, double open) : control_(control), close_(close), open_(open) {}

  void start(double v, bool on) { found_.on_at_start = on_ = v > close_ || (on && v >= open_); }

  // A jump from the left limit to v.
  void jump(double t, double v) {
    if (on_ ? v < open_ : v > close_) change(t);
  }

  // The signal from a to b, smooth and about monotone, with values va and vb; `linear`: between them a line.
  void piece(double a, double b, double va, double vb, bool linear) {
    const double level = on_ ? open_ : close_;
    if (on_ ? !(vb < level) : !(vb > level)) return;
    double t = a;
    if (linear) {
      t = vb == va ? a : a + (b - a) * (level - va) / (vb - va);
    } else {
      double low = a, high = b;
      for (int k = 0; k < 200 && high - low > 0; ++k) {
        t = (low + high) / 2;
        if (t <= low || t >= high) break;
        ((on_ ? value(control_, t) < level : value(control_, t) > level) ? high : low) = t;
      }
      t = high;
    }
    change(std::clamp(t, a, b));
  }

  SwitchTimes found() && { return std::move(found_); }

 private:
  void change(double t) {
    on_ = !on_;
    if (t > 0)
      found_.times.push_back(t);
    else
      found_.on_at_start = on_;
  }

  const Control& control_;
  double close_, open_;
  bool on_ = false;
  SwitchTimes found_;
};

}  // namespace

SwitchTimes switch_times(const Control& control, double close, double open, double T, std::optional<bool> on) {
  std::vector<double> marks{0, T};
  for (const auto& [source, factor] : control.sources) {
    const std::vector<double> own = source->breakpoints(T);
    marks.insert(marks.end(), own.begin(), own.end());
  }
  std::sort(marks.begin(), marks.end());
  marks.erase(std::unique(marks.begin(), marks.end()), marks.end());
  const double length = look_length(control, T);
  const bool linear = !std::isfinite(length);
  constexpr double most_looks = 1e8;
  if (!linear && T / length > most_looks)
    throw Error(".tran", "the sources that control a switch have too many periods up to its end", "shorten it");
  Search search(control, close, open);
  search.start(value(control, 0), on.value_or(false));
  for (std::size_t k = 0; k + 1 < marks.size(); ++k) {
    const double begin = marks[k], end = marks[k + 1];
    // Times of breakpoints are known to rounding: values are those in the piece.
    const double inside = begin + (end - begin) / 2;
    if (linear) {
      const double middle = value(control, inside), half = slope(control, inside) * (end - begin) / 2;
      search.jump(begin, middle - half);
      search.piece(begin, end, middle - half, middle + half, true);
      continue;
    }
    const double parts = std::max(1.0, std::ceil((end - begin) / length));
    const double margin = 1e-9 * (end - begin) / parts;
    double a = begin, va = value(control, begin + margin);
    search.jump(begin, va);
    for (double i = 1; i <= parts; ++i) {
      const double b = i == parts ? end : begin + (end - begin) * i / parts;
      const double vb = value(control, i == parts ? b - margin : b);
      search.piece(a, b, va, vb, false);
      a = b, va = vb;
    }
  }
  return std::move(search).found();
}

}  // namespace bromwich::circuits
