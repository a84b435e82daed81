#include "core/scene/source_steps.hpp"

#include "core/base/interruption.hpp"
#include "core/numerics/gauss_parabola.hpp"
#include "core/numerics/irregular.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr double rounding_of_places = 256 * epsilon;  ///< of T: how well the place of a jump is known
constexpr double same_value = 1e-9;                   ///< of the largest: one-sided values that differ by less
constexpr double strong_disagreement = 0.25;  ///< of the largest value: a step that misses this much is looked into
constexpr double linear_enough = 0.05;        ///< the same for g in a part of a rough step
constexpr double polynomial_enough = 1e-6, most_polynomial = 2e-2;  ///< the same for f in a piece
constexpr int many_pieces = 4;             ///< halvings of f: it goes up and down inside the step
constexpr double mean_of_piece = 1e-3;     ///< error of the mean there, by Gauss points, to the largest error
constexpr double longest_part = 0.25;      ///< of a step, where grids are compared
constexpr double smallest_part = 0x1p-36;  ///< of a step: shorter, it is a jump
constexpr double above_changes = 8;        ///< times the change beside: samples on both sides of a jump
constexpr std::size_t most_sudden = 16;    ///< such steps that are looked at
constexpr Index most_numbers = 16000000;   ///< that pieces of f may hold
constexpr Index most_leaves = 2048;        ///< of a step, for each source
constexpr Index most_in_vain = 16;         ///< steps that so many leaves do not resolve; later ones get fewer,
constexpr Index fewer_leaves = 128;        ///< enough for a jump
constexpr std::array<double, 2> inside{0.3819660112501051, 0.7320508075688772};  ///< irregular places of checks
constexpr std::array<double, 4> between_gauss{0, 0.2928932188134525, 0.7071067811865476, 1};
constexpr std::array<double, 7> looks{0.04, 0.19, 0.33, 0.47, 0.62, 0.78, 0.93};  ///< into parts of rough steps
constexpr Index many_looks = 34;       ///< into steps of fast sources, at multiples of the golden ratio: 0.035 apart
constexpr Index most_looks = 8000000;  ///< into all steps, beyond 7 for each
constexpr Index most_unknown = 49152;  ///< values of unknown sources that are looked at, all components together
constexpr double inside_end = 1e-6;    ///< of a piece: how near to its ends f is looked at

// One of the sources with its samples and the size of each component.
struct Inspected {
  Inspected(const TimeFunction& function, Index width, const SampledSource& samples, double resolution)
      : source(function, width, resolution),
        given(function && samples.size() > 0 && source.width() == samples.values().cols()),
        values(samples.values()) {
    if (!given) return;
    scale = values.cwiseAbs().colwise().maxCoeff().transpose();
    scale = scale.cwiseMax(1e-12 * (scale.size() > 0 ? scale.maxCoeff() : 0)).cwiseMax(1e-290);
  }

  // A value between the samples: those of a source that is faster than the grid may all be small.
  void inside(double t, Vector& v) {
    poll();
    source.value(t, v);
    scale = scale.cwiseMax(v.cwiseAbs());
  }

  // |u - v| relative to the largest values of each component, u among them.
  double apart(const Vector& u, const Vector& v) const {
    double most = 0;
    for (Index i = 0; i < u.size(); ++i)
      most = std::max(most, std::abs(u[i] - v[i]) / std::max(scale[i], std::abs(v[i])));
    return most;
  }

  OneSided source;
  Polling poll;
  bool given;
  const RowMatrix& values;
  Vector scale;
};

class Inspection {
 public:
  Inspection(const Scene& scene, const Vector& t, const SampledSource& f, const SampledSource& g)
      : t_(t),
        J_(t.size() - 1),
        h_((t[J_] - t[0]) / double(J_)),
        resolution_(rounding_of_places * std::max(std::abs(t[0]), std::abs(t[J_]))),
        f_(scene.f, scene.sources(), f, resolution_),
        g_(scene.g, scene.constraints(), g, resolution_),
        budget_(20000 + std::min(most_leaves * J_, most_numbers / (16 + f.values().cols()))) {
    found_.resolution = resolution_;
  }

  /// `spread`: looks over all steps, 0 where the breakpoints are known to be all.
  SourceSteps run(const std::vector<double>& breakpoints, bool every_step, Index spread) {
    if (J_ < 1 || (!f_.given && !g_.given)) return std::move(found_);
    short_parts_ = every_step;
    place(breakpoints);
    budget_ += 2 * Index(inner_.size());
    look_inside(every_step, spread);
    std::sort(seen_.begin(), seen_.end());
    for (Index j = 1; j <= J_ && any_rough_; ++j)
      if (rough_[std::size_t(j)]) take_apart(j);
    return std::move(found_);
  }

 private:
  // Breakpoints inside steps, and those at points of the grid that matter to the step before or behind.
  void place(const std::vector<double>& breakpoints) {
    if (breakpoints.empty()) return;
    rough_.assign(std::size_t(J_) + 1, false);
    for (const double b : breakpoints) {
      const Index near = std::clamp<Index>(Index(std::llround((b - t_[0]) / h_)), 0, J_);
      if (std::abs(b - t_[near]) <= 2 * resolution_) {
        if (at_points_.empty() || at_points_.back() != t_[near]) at_points_.push_back(t_[near]);
        const bool before = near > 0 && own_value(near, -1), behind = near < J_ && own_value(near, +1);
        if (before) mark(near);
        if (behind) mark(near + 1);
        continue;
      }
      const Index step = b > t_[near] ? near + 1 : near;
      if (step < 1 || step > J_ || (!inner_.empty() && b - inner_.back() <= 8 * resolution_)) continue;
      inner_.push_back(b);
      mark(step);
    }
  }

  void mark(Index step) {
    if (rough_.empty()) rough_.assign(std::size_t(J_) + 1, false);
    rough_[std::size_t(step)] = any_rough_ = true;
  }

  // Whether a source has a value at t_j that is not its limit from that side.
  bool own_value(Index j, int side) {
    bool differs = false;
    for (const Inspected* s : {&f_, &g_}) {
      if (!s->given) continue;
      const Vector v = side > 0 ? s->source.after(t_[j], h_) : s->source.before(t_[j], h_);
      if (s->apart(v, s->values.row(j).transpose()) <= same_value) continue;
      differs = true;
      if (s == &g_) found_.jumps_of_g = true;
    }
    return differs;
  }

  // Compares values inside steps without breakpoints with the linear function: where one is far off, in all steps.
  void look_inside(bool every_step, Index spread) {
    const Index some = std::clamp<Index>(J_ / 32, 4, 64);
    bool off = !every_step && look_everywhere(spread);
    for (Index k = 0; k < some && !every_step; ++k) {
      const double number = double(k) + 0.5;
      const Index j = 1 + std::min(J_ - 1, Index(double(J_) * irregular(number)));
      off |= misses(j, 0.15 + 0.7 * irregular_beside(number));
    }
    if (!every_step)
      for (const Index j : sudden_steps())
        for (const double part : looks) off |= misses(j, part);
    if (!every_step && !off) return;
    for (Index j = 1; j <= J_; ++j) off |= misses(j, 0.15 + 0.7 * irregular_beside(double(j)));
    // A look sees a pulse inside a step only if it meets it, and one pulse does not stand for another.
    const Index count = std::clamp<Index>(most_looks / J_, Index(looks.size()), many_looks);
    for (Index j = 1; j <= J_ && off; ++j)
      for (double k = 0; k < double(count); ++k) misses(j, irregular(k + 0.5), true);
  }

  // Values on a finer grid, whose times a source may compute all at once.
  bool look_everywhere(Index spread) {
    const Index width = (f_.given ? f_.source.width() : 0) + (g_.given ? g_.source.width() : 0);
    spread = std::min(spread, most_unknown / std::max<Index>(1, width));
    const Index parts = (spread + J_ - 1) / J_;
    bool off = false;
    for (Index j = 1; j <= J_; ++j) {
      if (any_rough_ && rough_[std::size_t(j)]) continue;
      for (Index k = 1; k < parts; ++k) {
        const double time = t_[0] + (t_[J_] - t_[0]) * double((j - 1) * parts + k) / double(J_ * parts);
        off |= misses_at(j, double(k) / double(parts), time);
      }
    }
    return off;
  }

  // Steps in which the samples change by a good part of their size, and hardly in the step before or behind: a few of
  // them, for where one has a jump all steps are looked at.
  std::vector<Index> sudden_steps() const {
    std::vector<Index> sudden;
    for (const Inspected* s : {&f_, &g_}) {
      if (!s->given) continue;
      const auto change = [s](Index j, Index i) { return std::abs(s->values(j, i) - s->values(j - 1, i)); };
      for (Index j = 1; j <= J_; ++j)
        for (Index i = 0; i < s->values.cols(); ++i) {
          const double here = change(j, i);
          if (!(here > strong_disagreement * s->scale[i])) continue;
          const double before = j > 1 ? change(j - 1, i) : here, behind = j < J_ ? change(j + 1, i) : here;
          if (!(here > above_changes * std::min(before, behind))) continue;
          if (sudden.empty() || sudden.back() != j) sudden.push_back(j);
          if (sudden.size() >= most_sudden) return sudden;
        }
    }
    return sudden;
  }

  bool misses(Index j, double part, bool in_all_steps = false) {
    if (!in_all_steps && any_rough_ && rough_[std::size_t(j)]) return false;
    return misses_at(j, part, t_[j - 1] + part * (t_[j] - t_[j - 1]));
  }

  bool misses_at(Index j, double part, double time) {
    bool off = false;
    for (Inspected* s : {&f_, &g_}) {
      if (!s->given) continue;
      s->inside(time, value_);
      line_ = (1 - part) * s->values.row(j - 1).transpose() + part * s->values.row(j).transpose();
      const double apart = s->apart(value_, line_);
      if (!(apart > strong_disagreement)) continue;
      off = true;
      if (s == &g_) found_.disagreement_of_g = std::max(found_.disagreement_of_g, apart);
    }
    if (off) mark(j);
    if (off) seen_.emplace_back(j, time);
    return off;
  }

  // Looks at the places between a and b at which the source was seen not to be linear in the step at hand.
  template <class Look>
  void look_again(double a, double b, const Look& look) const {
    const std::pair<Index, double> from(step_, a), to(step_, b);
    const auto last = std::lower_bound(seen_.begin(), seen_.end(), to);
    for (auto place = std::upper_bound(seen_.begin(), last, from); place != last; ++place)
      look((place->second - a) / (b - a));
  }

  void take_apart(Index j) {
    const auto first = std::upper_bound(inner_.begin(), inner_.end(), t_[j - 1]),
               last = std::lower_bound(inner_.begin(), inner_.end(), t_[j]);
    RoughStep step;
    step.step = j;
    missed_ = 0;
    step_ = j;
    divide(t_[j - 1], cuts_of(j, first, last), step);
    if (f_.given) {
      std::vector<double> ends(first, last);
      ends.insert(ends.end(), step.ends.begin(), step.ends.end());
      std::sort(ends.begin(), ends.end());
      ends.erase(std::unique(ends.begin(), ends.end()), ends.end());
      fit(t_[j - 1], ends, step);
    }
    if (missed_ > 0 && ++found_.unresolved >= most_in_vain) allowed_ = fewer_leaves;
    note(missed_, t_[j - 1]);
    found_.rough.push_back(std::move(step));
  }

  // The breakpoints first .. last inside step j, and its end. Where grids are compared, parts between two breakpoints
  // are more on finer grids, too, though no point of these falls between them: as many as there are steps for each
  // breakpoint.
  template <class Place>
  std::vector<double> cuts_of(Index j, Place first, Place last) const {
    const double parts = short_parts_ ? double(J_ / Index(inner_.size() + at_points_.size() + 1)) : 1;
    std::vector<double> cuts;
    double from = t_[j - 1];
    bool jumps = is_at_breakpoint(from);
    const auto add = [&](double to, bool jumps_there) {
      for (double k = 1; k < parts && jumps && jumps_there; ++k) cuts.push_back(from + (to - from) * k / parts);
      cuts.push_back(to);
      from = to;
      jumps = jumps_there;
    };
    for (Place cut = first; cut != last; ++cut) add(*cut, true);
    add(t_[j], is_at_breakpoint(t_[j]));
    return cuts;
  }

  bool is_at_breakpoint(double point) const { return std::binary_search(at_points_.begin(), at_points_.end(), point); }

  void note(double apart, double t) {
    if (!(apart > found_.disagreement)) return;
    found_.disagreement = apart;
    found_.time = t;
  }

  // Parts between the cuts on which g is linear, or nearly so.
  void divide(double from, const std::vector<double>& cuts, RoughStep& step) {
    Vector before;
    for (const double to : cuts) {
      if (g_.given) {
        const Vector start = g_.source.after(from, to - from), end = g_.source.before(to, to - from);
        if (before.size() > 0 && g_.apart(before, start) > same_value) found_.jumps_of_g = true;
        leaves_ = 0;
        halve(from, start, to, end, 0, step.ends);
        before = end;
      } else {
        add_part(from, to, step.ends);
      }
      from = to;
    }
  }

  // A part between jumps is the same on all grids whose steps are longer. Where grids are compared, its error shows
  // when parts are short beside the step.
  void add_part(double from, double to, std::vector<double>& ends) const {
    const double parts = short_parts_ ? std::ceil((to - from) / (longest_part * h_)) : 1;
    for (double k = 1; k < parts; ++k) ends.push_back(from + (to - from) * k / parts);
    ends.push_back(to);
  }

  void halve(double a, const Vector& ga, double b, const Vector& gb, int depth, std::vector<double>& ends) {
    double apart = 0;
    const auto look = [&](double part) {
      g_.inside(a + part * (b - a), value_);
      line_ = (1 - part) * ga + part * gb;
      apart = std::max(apart, g_.apart(value_, line_));
    };
    if (depth <= many_pieces)
      for (const double part : looks) look(part);
    else
      for (const double part : inside) look(part);
    look_again(a, b, look);
    ++leaves_;
    --budget_;
    if (apart > strong_disagreement) found_.disagreement_of_g = std::max(found_.disagreement_of_g, apart);
    const bool jump = b - a <= std::max(smallest_part * h_, 8 * resolution_);
    if (jump && apart > linear_enough) found_.jumps_of_g = true;
    if (!(apart > linear_enough) || jump || leaves_ >= allowed_ || budget_ <= 0) {
      if (apart > strong_disagreement && !jump) missed_ = std::max(missed_, apart);
      if (depth > 0 && !jump) note(apart, a);  // grids of J and 2J steps share such parts
      add_part(a, b, ends);
      return;
    }
    const double middle = a + (b - a) / 2;
    Vector g;
    g_.source.value(middle, g);
    halve(a, ga, middle, g, depth + 1, ends);
    halve(middle, g, b, gb, depth + 1, ends);
  }

  void fit(double from, const std::vector<double>& ends, RoughStep& step) {
    for (const double to : ends) {
      leaves_ = 0;
      fit(from, to, 0, step.pieces);
      from = to;
    }
  }

  // Halves what is not a polynomial of degree 2. The shorter a piece, the less its error counts; where many are needed
  // f goes up and down, and so does its error.
  void fit(double a, double b, int depth, std::vector<SourcePiece>& pieces) {
    const double d = b - a;
    SourcePiece piece{a, d, {}};
    std::array<Vector, 3> v;
    for (std::size_t i = 0; i < 3; ++i) f_.inside(a + gauss_points[i] * d, v[i]);
    const std::array<Vector, 3> c = gauss_parabola(v);
    piece.phi.resize(v[0].size(), 3);
    piece.phi << c[0], c[1], c[2];
    double apart = 0;
    const double margin = std::min(std::max(inside_end, 4 * resolution_ / d), 0.5);
    const auto look = [&](double place) {
      const double part = std::clamp(place, margin, 1 - margin);
      f_.inside(a + part * d, value_);
      line_ = piece.phi * Eigen::Vector3d(1, part, part * part);
      apart = std::max(apart, f_.apart(value_, line_));
    };
    for (const double place : between_gauss) look(place);
    look_again(a, a + d, look);
    ++leaves_;
    --budget_;
    const bool jump = d <= std::max(smallest_part * h_, 8 * resolution_);
    if (!(apart > std::min(std::ldexp(polynomial_enough, 2 * depth), most_polynomial)) || jump || leaves_ >= allowed_ ||
        budget_ <= 0) {
      if (apart > strong_disagreement && !jump) missed_ = std::max(missed_, apart);
      if (depth >= many_pieces && !jump) note(mean_of_piece * apart, a);
      pieces.push_back(std::move(piece));
      return;
    }
    fit(a, a + d / 2, depth + 1, pieces);
    fit(a + d / 2, b, depth + 1, pieces);
  }

  const Vector& t_;
  Index J_;
  double h_, resolution_;
  Inspected f_, g_;
  Index budget_, leaves_ = 0, allowed_ = most_leaves;
  SourceSteps found_;
  std::vector<double> inner_;      ///< breakpoints inside steps
  std::vector<double> at_points_;  ///< points of the grid that are breakpoints
  std::vector<bool> rough_;        ///< by step, empty where none is
  bool any_rough_ = false;
  bool short_parts_ = false;
  double missed_ = 0;                           ///< by the parts and pieces of a step
  std::vector<std::pair<Index, double>> seen_;  ///< steps, and times inside at which a source is not linear
  Index step_ = 0;                              ///< at hand
  Vector value_, line_;
};

}  // namespace

const RoughStep* SourceSteps::at(Index step) const {
  const auto found =
      std::lower_bound(rough.begin(), rough.end(), step, [](const RoughStep& r, Index j) { return r.step < j; });
  return found != rough.end() && found->step == step ? &*found : nullptr;
}

bool jumps_at_end(const Scene& scene) {
  constexpr double jump = 1e-9;  // of the values: less is the motion before T
  const auto jumps = [T = scene.T](const TimeFunction& source, Index width) {
    if (!source || width == 0) return false;
    const OneSided sides(source, width, 256 * epsilon * T);
    Vector own;
    sides.value(T, own);
    const Vector before = sides.before(T, T);
    return (own - before).cwiseAbs().maxCoeff() > jump * own.cwiseAbs().cwiseMax(before.cwiseAbs()).maxCoeff();
  };
  return jumps(scene.g, scene.constraints()) || jumps(scene.f, scene.f ? scene.sources() : 0);
}

SourceSteps find_source_steps(const Scene& scene, const Vector& t, const SampledSource& f, const SampledSource& g,
                              bool every_step, Index looks) {
  return Inspection(scene, t, f, g)
      .run(scene.breakpoints, every_step, scene.breakpoints_are_all || scene.no_pulses ? 0 : looks);
}

}  // namespace bromwich
