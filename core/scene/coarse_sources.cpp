#include "core/scene/coarse_sources.hpp"

#include "core/base/text.hpp"
#include "core/numerics/irregular.hpp"
#include "core/scene/source_steps.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich {

namespace {

constexpr double coarse = 0.15;          ///< of the size: a sine with 5.7 steps a period
constexpr Index share_of_looks = 8;      ///< one of so many looks has to be coarse
constexpr Index fewest_looks = 8;        ///< at first, into as many steps
constexpr Index most_looks = 64;         ///< into the steps of long grids, and where one is coarse
constexpr Index steps_of_a_look = 32;    ///< at first one step of so many
constexpr int halvings_to_a_jump = 12;   ///< of a step
constexpr double most_of_a_jump = 0.75;  ///< of what a source changes by in a step, in 2^-12 of it

struct Look {
  double time, part;
  Vector left, inside, right;
};

class Looks {
 public:
  Looks(const TimeFunction& function, Index width, const std::vector<double>& breakpoints, const Vector& t)
      : source_(function, width, 0), breakpoints_(breakpoints), t_(t), scale_(Vector::Zero(source_.width())) {}

  CoarseSources run() {
    if (source_.width() == 0) return {};
    const Index J = t_.size() - 1, first = std::min(J, std::clamp(J / steps_of_a_look, fewest_looks, most_looks));
    take(0, first);
    if (coarse_ones() > 0) take(first, std::min(J, first + most_looks));
    return coarse_ones() * share_of_looks > Index(looks_.size()) ? found_ : CoarseSources{};
  }

 private:
  // Looks number k of a sequence without a pattern, at places in the middle part of steps.
  void take(Index from, Index to) {
    const Index J = t_.size() - 1;
    for (Index k = from; k < to; ++k) {
      const Index j = std::min(J - 1, Index(double(J) * irregular(double(k) + 0.5)));
      if (holds_breakpoint(j)) continue;
      Look look{0, 0.3 + 0.4 * irregular_beside(double(k) + 0.5), {}, {}, {}};
      look.time = t_[j] + look.part * (t_[j + 1] - t_[j]);
      source_.value(t_[j], look.left);
      source_.value(look.time, look.inside);
      source_.value(t_[j + 1], look.right);
      for (const Vector* v : {&look.left, &look.inside, &look.right}) scale_ = scale_.cwiseMax(v->cwiseAbs());
      if (!jumps(look, t_[j], t_[j + 1])) looks_.push_back(std::move(look));
    }
  }

  bool holds_breakpoint(Index j) const {
    const double beside = 1e-9 * (t_[j + 1] - t_[j]);
    const auto next = std::lower_bound(breakpoints_.begin(), breakpoints_.end(), t_[j] - beside);
    return next != breakpoints_.end() && *next <= t_[j + 1] + beside;
  }

  // Follows the larger change into halves: that of a source without jumps becomes small.
  bool jumps(const Look& look, double a, double b) const {
    Vector left = look.left, right = look.right, middle;
    const auto change = [this](const Vector& u, const Vector& v) {
      return ((u - v).array() != 0).select((u - v).cwiseAbs().cwiseQuotient(scale_), 0).maxCoeff();
    };
    const double whole = std::max({change(left, right), change(left, look.inside), change(look.inside, right)});
    if (whole <= coarse) return false;
    for (int k = 0; k < halvings_to_a_jump; ++k) {
      const double m = (a + b) / 2;
      source_.value(m, middle);
      const bool first = change(left, middle) >= change(middle, right);
      (first ? b : a) = m;
      (first ? right : left) = middle;
    }
    return change(left, right) > most_of_a_jump * whole;
  }

  Index coarse_ones() {
    Index count = 0;
    for (const Look& look : looks_) {
      const Vector apart = (look.inside - (1 - look.part) * look.left - look.part * look.right).cwiseAbs();
      double missed = 0;
      for (Index i = 0; i < apart.size(); ++i)
        if (apart[i] > 0) missed = std::max(missed, apart[i] / std::max(scale_[i], 1e-12 * scale_.maxCoeff()));
      if (missed > coarse) ++count;
      if (missed > found_.missed) found_ = {missed, look.time};
    }
    return count;
  }

  OneSided source_;
  const std::vector<double>& breakpoints_;
  const Vector& t_;
  Vector scale_;
  std::vector<Look> looks_;
  CoarseSources found_;
};

}  // namespace

CoarseSources find_coarse_sources(const Scene& scene, const Vector& t) {
  if (t.size() < 2) return {};
  const CoarseSources f = Looks(scene.f, scene.f ? scene.sources() : 0, scene.breakpoints, t).run(),
                      g = Looks(scene.g, scene.g ? scene.constraints() : 0, scene.breakpoints, t).run();
  return f.missed > g.missed ? f : g;
}

}  // namespace bromwich
