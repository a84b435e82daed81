#include "core/scene/breakpoints.hpp"

#include "core/scene/source_steps.hpp"

#include <algorithm>
#include <array>
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

class Search {
 public:
  Search(const TimeFunction& function, Index width, double T, bool kinks)
      : source_(function, width, 0),
        T_(T),
        times_(std::clamp(most_values / std::max<Index>(1, source_.width()), fewest_times, most_times)),
        looks_for_kinks_(kinks) {}

  std::vector<double> run() {
    const Index n = source_.width();
    Vector before(n), v(n);
    source_.value(0, before);
    scale_ = before.cwiseAbs();
    RowMatrix changes(times_, n);
    for (Index k = 1; k <= times_; ++k) {
      source_.value(time(k), v);
      if (!v.allFinite()) return {};
      scale_ = scale_.cwiseMax(v.cwiseAbs());
      changes.row(k - 1) = (v - before).transpose();
      before.swap(v);
    }
    scale_ = scale_.cwiseMax(1e-12 * (n > 0 ? scale_.maxCoeff() : 0)).cwiseMax(1e-290);
    std::vector<double> change(static_cast<std::size_t>(times_));
    for (Index k = 0; k < times_; ++k)
      change[std::size_t(k)] = changes.row(k).transpose().cwiseAbs().cwiseQuotient(scale_).maxCoeff();
    for (Index k = 0; k < times_; ++k) {
      const double limit = std::max(least_jump, stands_out * beside(change, k));
      if (change[std::size_t(k)] > limit) narrow(time(k), time(k + 1), limit);
      if (found_.size() > most_jumps) return {};
    }
    const std::size_t jumps = found_.size();
    if (looks_for_kinks_) find_kinks(changes);
    if (found_.size() - jumps > most_jumps) found_.resize(jumps);
    return std::move(found_);
  }

 private:
  double time(Index k) const { return k == times_ ? T_ : T_ * double(k) / double(times_); }

  // A quiet one of the changes around: jumps nearby do not count.
  static double beside(const std::vector<double>& change, Index k) {
    constexpr Index reach = 4;
    std::array<double, 2 * reach> around{};
    std::size_t count = 0;
    for (Index i = std::max<Index>(0, k - reach); i <= std::min(Index(change.size()) - 1, k + reach); ++i)
      if (i != k) around[count++] = change[std::size_t(i)];
    std::nth_element(around.begin(), around.begin() + std::ptrdiff_t(count / 2),
                     around.begin() + std::ptrdiff_t(count));
    return around[count / 2];
  }

  // Where the slope changes much more than beside: second differences stand out at one or two times.
  void find_kinks(const RowMatrix& changes) {
    std::vector<double> bend(std::size_t(times_) - 1);  // at time(k + 1)
    for (Index k = 0; k + 1 < times_; ++k)
      bend[std::size_t(k)] =
          (changes.row(k + 1) - changes.row(k)).transpose().cwiseAbs().cwiseQuotient(scale_).maxCoeff();
    std::sort(found_.begin(), found_.end());
    const double d = T_ / double(times_);
    for (Index k = 1; k + 2 < times_; ++k) {
      const double here = bend[std::size_t(k)];
      const bool highest = here >= bend[std::size_t(k) - 1] && here > bend[std::size_t(k) + 1];
      if (!highest || !(here > std::max(least_kink, stands_out * beside(bend, k)))) continue;
      const double near = time(k + 1);
      const auto jump = std::lower_bound(found_.begin(), found_.end(), near - 3 * d);
      if (jump != found_.end() && *jump <= near + 3 * d) continue;
      Index component = 0;
      (changes.row(k + 1) - changes.row(k)).transpose().cwiseAbs().cwiseQuotient(scale_).maxCoeff(&component);
      const double first = meeting_point(near, d, component);
      if (std::isnan(first) || std::abs(first - near) > d) continue;
      const double second = meeting_point(first, d / 32, component);
      kinks_.push_back(std::isnan(second) || std::abs(second - first) > d / 32 ? first : second);
      if (kinks_.size() > most_jumps) break;
    }
    found_.insert(found_.end(), kinks_.begin(), kinks_.end());
  }

  // Of the lines on both sides of t, each through values at distances d and 2 d.
  double meeting_point(double t, double d, Index i) {
    std::array<double, 4> v{};
    const std::array<double, 4> at{t - 2 * d, t - d, t + d, t + 2 * d};
    Vector all;
    for (std::size_t k = 0; k < 4; ++k) {
      if (at[k] < 0 || at[k] > T_) return NAN;
      source_.value(at[k], all);
      v[k] = all[i];
    }
    const double left = (v[1] - v[0]) / d, right = (v[3] - v[2]) / d;
    // v1 + left (s - t + d) = v2 + right (s - t - d)
    return t + (v[2] - v[1] - d * (left + right)) / (left - right);
  }

  double apart(const Vector& u, const Vector& v) const { return (u - v).cwiseAbs().cwiseQuotient(scale_).maxCoeff(); }

  // All jumps above the limit between a and b.
  void narrow(double a, double b, double limit) {
    Vector va, vb, v;
    source_.value(a, va);
    source_.value(b, vb);
    const double whole = apart(va, vb), first = a, last = b;
    Vector v_last = vb;
    while (b - a > place * T_) {
      const double middle = a + (b - a) / 2;
      source_.value(middle, v);
      if (apart(va, v) >= apart(v, vb)) {
        b = middle;
        vb.swap(v);
      } else {
        a = middle;
        va.swap(v);
      }
    }
    if (!(apart(va, vb) > 0.5 * std::min(whole, 2 * limit))) return;
    Vector v_first;
    source_.value(first, v_first);
    if (a > first && apart(v_first, va) > limit && found_.size() <= most_jumps) narrow(first, a, limit);
    found_.push_back(b);
    if (b < last && apart(vb, v_last) > limit && found_.size() <= most_jumps) narrow(b, last, limit);
  }

  OneSided source_;
  double T_;
  Index times_;
  bool looks_for_kinks_;
  Vector scale_;
  std::vector<double> found_, kinks_;
};

}  // namespace

std::vector<double> find_breakpoints(const Scene& scene) {
  std::vector<double> all = scene.breakpoints;
  const bool kinks = scene.dynamics->small_state() && scene.states() + scene.constraints() <= largest_with_kinks;
  const std::array<std::pair<const TimeFunction*, Index>, 2> sources{
      {{&scene.f, scene.sources()}, {&scene.g, scene.constraints()}}};
  for (const auto& [function, width] : sources) {
    if (!*function || OneSided(*function, width, 0).width() > most_values / fewest_times)
      continue;  // too many to look at
    if (width == 0) continue;
    for (const double t : Search(*function, width, scene.T, kinks).run())
      if (t > 0 && t < scene.T) all.push_back(t);
  }
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

}  // namespace bromwich
