#include "core/scene/breakpoints.hpp"

#include "core/base/interruption.hpp"
#include "core/scene/memory.hpp"
#include "core/scene/source_steps.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr Index most_times = 65536, fewest_times = 1024;
constexpr Index most_values = 4000000;  ///< of a source that are looked at
constexpr double stands_out = 8;        ///< times the change beside
constexpr double least_jump = 1e-6;     ///< of the largest value
constexpr double least_kink = 1e-8;     ///< of the largest value: change of slope between two of the times
/// Unknowns of a scene whose steps are taken in parts at kinks too: larger ones gain less than the parts cost.
constexpr Index largest_with_kinks = 32;
constexpr double place = 16 * epsilon;    ///< of T
constexpr std::size_t most_jumps = 8192;  ///< more are no jumps but noise, or as fast as the times that are looked at
constexpr std::size_t most_closer = 256;  ///< jumps beside which kinks are looked for at closer times
constexpr Index closer = 16;              ///< times as close

class Search {
 public:
  Search(const TimeFunction& function, Index width, double T, bool kinks)
      : source_(function, width, 0),
        T_(T),
        times_(std::clamp(most_values / std::max<Index>(1, source_.width()), fewest_times, most_times)),
        looks_for_kinks_(kinks) {}

  // Component by component: a jump of one is not hidden by fast changes of another.
  std::vector<double> run() {
    Matrix values(times_ + 1, source_.width());
    Vector v;
    for (Index k = 0; k <= times_; ++k) {
      poll_();
      source_.value(time(k), v);
      if (!v.allFinite()) return {};
      values.row(k) = v.transpose();
    }
    const double largest = values.size() > 0 ? values.cwiseAbs().maxCoeff() : 0;
    std::vector<double> kinks;
    for (Index i = 0; i < values.cols(); ++i) {
      component_ = i;
      scale_ = std::max({values.col(i).cwiseAbs().maxCoeff(), 1e-12 * largest, 1e-290});
      jumps_.clear();
      find_jumps(values.col(i).tail(times_) - values.col(i).head(times_));
      std::sort(jumps_.begin(), jumps_.end());
      found_.insert(found_.end(), jumps_.begin(), jumps_.end());
      if (found_.size() > most_jumps) return {};
      if (looks_for_kinks_) find_kinks(values.col(i), kinks);
    }
    if (kinks.size() <= most_jumps) found_.insert(found_.end(), kinks.begin(), kinks.end());
    return std::move(found_);
  }

 private:
  double time(Index k) const { return k == times_ ? T_ : T_ * double(k) / double(times_); }

  double value(double t) {
    poll_();
    source_.value(t, all_);
    return all_[component_];
  }

  static constexpr Index reach = 4;

  // A quiet one of the changes around: jumps nearby do not count.
  static double beside(const Vector& change, Index k) {
    std::array<double, 2 * reach> around{};
    std::size_t count = 0;
    for (Index i = std::max<Index>(0, k - reach); i <= std::min(change.size() - 1, k + reach); ++i)
      if (i != k) around[count++] = change[i];
    const auto middle = around.begin() + std::ptrdiff_t(count / 2);
    std::nth_element(around.begin(), middle, around.begin() + std::ptrdiff_t(count));
    return *middle;
  }

  // Whether a change is above `least` and above those beside; most are not above their neighbours'.
  static bool is_above(const Vector& change, Index k, double least) {
    const double here = change[k];
    if (!(here > least)) return false;
    Index lower = 0, count = 0;
    for (Index i = std::max<Index>(0, k - reach); i <= std::min(change.size() - 1, k + reach); ++i) {
      count += i != k;
      lower += i != k && here > stands_out * change[i];
    }
    return lower > count / 2;
  }

  void find_jumps(const Vector& changes) {
    const Vector change = changes.cwiseAbs() / scale_;
    for (Index k = 0; k < times_ && jumps_.size() <= most_jumps; ++k)
      if (is_above(change, k, least_jump))
        narrow(time(k), time(k + 1), std::max(least_jump, stands_out * beside(change, k)));
  }

  bool has_jump(double from, double to) const {
    const auto jump = std::lower_bound(jumps_.begin(), jumps_.end(), from);
    return jump != jumps_.end() && *jump <= to;
  }

  // Kinks away from the jumps of this component, and those beside, at closer times on one side of a jump.
  void find_kinks(const Vector& values, std::vector<double>& kinks) {
    const double d = T_ / double(times_);
    find_kinks(values, 0, d, kinks);
    if (jumps_.size() > most_closer) return;
    constexpr Index count = 4 * closer;
    const double step = d / double(closer);
    Vector near(count);
    for (std::size_t j = 0; j < jumps_.size(); ++j)
      for (const double side : {-1.0, 1.0}) {
        const double from = side > 0 ? jumps_[j] + place * T_ : jumps_[j] - place * T_ - double(count - 1) * step;
        const double to = from + double(count - 1) * step;
        if (from < 0 || to > T_ || has_jump(side > 0 ? from : from - step, side > 0 ? to + step : to)) continue;
        for (Index k = 0; k < count; ++k) near[k] = value(from + double(k) * step);
        find_kinks(near, from, step, kinks);
      }
  }

  // Where the slope changes much more than beside: second differences stand out at one or two times. `values` at
  // start, start + d, ...
  void find_kinks(const Vector& values, double start, double d, std::vector<double>& kinks) {
    const Index count = values.size();
    const Vector bend =
        (values.tail(count - 2) - 2 * values.segment(1, count - 2) + values.head(count - 2)).cwiseAbs() / scale_;
    for (Index k = 1; k + 1 < bend.size() && kinks.size() <= most_jumps; ++k) {
      if (!(bend[k] >= bend[k - 1] && bend[k] > bend[k + 1]) || !is_above(bend, k, least_kink)) continue;
      const double near = start + d * double(k + 1);
      if (has_jump(near - 3 * d, near + 3 * d)) continue;
      const double first = meeting_point(near, d);
      if (std::isnan(first) || std::abs(first - near) > d) continue;
      const double second = meeting_point(first, d / 32);
      kinks.push_back(std::isnan(second) || std::abs(second - first) > d / 32 ? first : second);
    }
  }

  // Of the lines on both sides of t, each through values at distances d and 2 d.
  double meeting_point(double t, double d) {
    std::array<double, 4> v{};
    const std::array<double, 4> at{t - 2 * d, t - d, t + d, t + 2 * d};
    for (std::size_t k = 0; k < 4; ++k) {
      if (at[k] < 0 || at[k] > T_) return NAN;
      v[k] = value(at[k]);
    }
    const double left = (v[1] - v[0]) / d, right = (v[3] - v[2]) / d;
    // v1 + left (s - t + d) = v2 + right (s - t - d)
    return t + (v[2] - v[1] - d * (left + right)) / (left - right);
  }

  double apart(double u, double v) const { return std::abs(u - v) / scale_; }

  // All jumps above the limit between a and b.
  void narrow(double a, double b, double limit) {
    const double first = a, last = b, v_last = value(b);
    double va = value(a), vb = v_last;
    const double v_first = va, whole = apart(va, vb);
    while (b - a > place * T_) {
      const double middle = a + (b - a) / 2, v = value(middle);
      if (apart(va, v) >= apart(v, vb))
        b = middle, vb = v;
      else
        a = middle, va = v;
    }
    if (!(apart(va, vb) > 0.5 * std::min(whole, 2 * limit))) return;
    if (a > first && apart(v_first, va) > limit && jumps_.size() <= most_jumps) narrow(first, a, limit);
    jumps_.push_back(b);
    if (b < last && apart(vb, v_last) > limit && jumps_.size() <= most_jumps) narrow(b, last, limit);
  }

  OneSided source_;
  Polling poll_;
  double T_;
  Index times_;
  bool looks_for_kinks_;
  Index component_ = 0;  ///< that is looked at
  double scale_ = 1;     ///< its largest value
  Vector all_;
  std::vector<double> found_, jumps_;  ///< of all components; of this one
};

}  // namespace

std::vector<double> find_breakpoints(const Scene& scene) {
  std::vector<double> all = scene.breakpoints;
  const bool kinks = scene.dynamics->small_state() && scene.states() + scene.constraints() <= largest_with_kinks;
  for_each_source(scene, [&](const TimeFunction& function, Index width) {
    if (!function || OneSided(function, width, 0).width() > most_values / fewest_times) return;  // too many to look at
    if (width == 0) return;
    for (const double t : Search(function, width, scene.T, kinks).run())
      if (t > 0 && t < scene.T) all.push_back(t);
  });
  std::sort(all.begin(), all.end());
  // One that is named and found stays as it was named.
  std::vector<double> different;
  const double same = 64 * epsilon * scene.T;
  for (const double t : all) {
    if (different.empty() || t - different.back() > same)
      different.push_back(t);
    else if (std::binary_search(scene.breakpoints.begin(), scene.breakpoints.end(), t))
      different.back() = t;
  }
  return different;
}

Scene with_all_breakpoints(Scene scene) {
  if (scene.breakpoints_are_all || (!scene.f && !scene.g && scene.memories.empty())) return scene;
  scene.breakpoints = find_breakpoints(scene);
  scene.breakpoints_are_all = true;
  return scene;
}

}  // namespace bromwich
