#include "core/march/stage_grid.hpp"

#include "core/march/dyadic_parts.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <set>
#include <utility>

namespace bromwich {

namespace {

constexpr std::size_t most_contacts = 64;  ///< divided steps; more contacts mean chattering
constexpr double brief = 0x1p-20;          ///< of a step: parts for impulses

StageGrid whole_steps(const DiscreteProblem& p) {
  StageGrid grid{p.t, {}, {}, {}, std::vector<Index>(std::size_t(p.J) + 1), {}, {}};
  std::iota(grid.step.begin(), grid.step.end(), Index(0));
  grid.at = grid.step;
  return grid;
}

// Divides steps after jumps into parts. An impulse gets a part of its own: within a longer step it may be undone before
// the first stage, and implicit Euler takes the whole step with it.
//
// After a jump of the state or of f, and at the start, the state has a boundary layer of width 1/||A||, and y follows
// it. The layer is resolved by geometrically growing parts, more of them on finer grids. A grid given by the user is
// divided behind impulses only, in the step after them.
class Layers {
 public:
  Layers(const DiscreteProblem& p, LayersOf which) : all_(which == LayersOf::all_jumps), step_(p.h) {
    if (which == LayersOf::nothing || !p.small_state()) return;
    const bool affords_layers = p.scene.states() <= most_states;
    if (all_ && !affords_layers) return;
    const double rate = p.small_state()->A.cwiseAbs().rowwise().sum().maxCoeff();
    start_ = p.t[0];
    const bool at_start = all_ || which == LayersOf::impulses_and_start;
    if (at_start) begin_.insert(start_);
    if (p.sources && (all_ || !takes_limits_at_points(p))) place_jumps(p);
    if (begin_.empty()) return;
    const Index count = Index(begin_.size());
    first_ = 0.1 / (std::max(rate, 1 / p.h) * double(p.J));
    first_ = std::max(first_, all_ ? least_first * epsilon * p.t[p.J] : brief * p.h);
    if (!affords_layers || !(rate * p.h > stiff)) return;
    const double factorization = std::pow(double(p.scene.states() + p.scene.constraints()), 3);
    const Index affordable = all_ ? std::max(p.J, Index(cheap / factorization)) : std::max(p.J, fewest);
    const auto growth = [&](Index layers) {
      const Index parts = std::clamp(p.J / (4 * layers), fewest, most);
      return typical_decades / double(std::clamp<Index>(affordable / layers, 1, parts));
    };
    growth_ = growth(count);
    growth_at_start_ = fewest * count <= affordable || !at_start ? growth_ : growth(1);
  }

  bool none() const { return begin_.empty(); }

  // Appends the ends of the parts of (from, to]. Call with increasing times.
  void divide(double from, double to, std::vector<double>& ends) {
    if (begin_.count(from) > 0) {
      last_ = from;
      if (from + first_ < to) ends.push_back(from + first_);
      from = last_ + std::min(first_, to - from);
    }
    const double behind = from - last_, growth = last_ > start_ ? growth_ : growth_at_start_;
    const bool over = !all_ && behind >= (1 - same_at_end) * step_;
    const double parts = over ? 1 : std::ceil(std::log1p((to - from) / behind) / growth);
    for (double k = 1; k < parts; ++k) ends.push_back(last_ + behind * std::pow(1 + (to - from) / behind, k / parts));
    if (to > from) ends.push_back(to);
  }

 private:
  void place_jumps(const DiscreteProblem& p) {
    const OneSided f(p.scene.f, p.scene.sources(), p.sources->resolution),
        g(p.scene.g, p.scene.constraints(), p.sources->resolution);
    const auto largest = [](const OneSided& source, const SampledSource& samples) {
      return samples.size() == 0 || source.width() == 0 ? INFINITY : samples.values().cwiseAbs().maxCoeff();
    };
    const double size_of_f = largest(f, p.f), size_of_g = largest(g, p.g);
    const auto jumps = [](const OneSided& source, double size, double t, double behind, double ahead) {
      if (std::isinf(size)) return false;
      return (source.after(t, ahead) - source.before(t, behind)).cwiseAbs().maxCoeff() > same_at_end * size;
    };
    for (const RoughStep& rough : p.sources->rough) {
      double from = p.t[rough.step - 1], before = p.h;
      for (const double to : rough.ends) {
        const bool behind_place = before <= shortest * p.h;  // parts this short enclose a located jump
        if ((all_ && (behind_place || jumps(f, size_of_f, from, before, to - from))) ||
            jumps(g, size_of_g, from, before, to - from))
          begin_.insert(from);
        before = to - from;
        from = to;
      }
    }
  }

  bool all_;                             ///< jumps, not only impulses
  double step_;                          ///< of the grid: layers behind impulses are divided up to this distance
  static constexpr double stiff = 0.05;  ///< ||A|| h above which a step does not resolve the layer
  static constexpr double shortest = 0x1p-30;
  static constexpr double least_first = 64;        ///< times the rounding of T: ends of parts are different times
  static constexpr Index most_states = 64;         ///< every part length has its own factorization
  static constexpr Index fewest = 48, most = 400;  ///< parts of a layer
  static constexpr double typical_decades = 16;    ///< logarithm of the ratio of a step to the first part of its layer
  static constexpr double cheap = 1e7;             ///< operations that parts of small scenes may cost on any grid
  std::set<double> begin_;
  double first_ = 0;  ///< length of the part after a jump
  /// Logarithmic growth of the distance to the jump from one point to the next; infinite: one part for the rest. A row
  /// after a jump may exist on the finest grid only, so comparing grids would not show that its layer is missing. With
  /// many jumps their layers have fewer parts, and more on finer grids.
  double growth_ = INFINITY, growth_at_start_ = INFINITY, start_ = 0;
  double last_ = -INFINITY;  ///< last jump passed
};

void divide_contact(double contact, double from, double h, std::vector<double>& ends) {
  const double to = ends.back(), begin = ends.size() > 1 ? ends[ends.size() - 2] : from;
  if (contact > begin && contact < to) {
    for (const double behind : {1, 2, 4})
      if (contact + (behind + 1) * h / 256 < to) ends.insert(ends.end() - 1, contact + behind * h / 256);
    if (contact + 3 * h / 256 < to) return;
  }
  const double last = ends.size() > 1 ? std::max(begin, ends[ends.size() - 2]) : begin;
  ends.insert(ends.end() - 1, {to - (to - last) / 16, to - (to - last) / 256});
}

// The first root after t[2] of the parabola through w at three times; NaN if there is none.
double predicted_root(const Vector& t, const Vector& w) {
  const double slope = (w[2] - w[1]) / (t[2] - t[1]), before = (w[1] - w[0]) / (t[1] - t[0]);
  const double bend = (slope - before) / (t[2] - t[0]), at_end = slope + bend * (t[2] - t[1]);
  const double root = at_end * at_end - 4 * bend * w[2];
  if (!(w[2] > 0) || !(root >= 0)) return NAN;
  return t[2] + 2 * w[2] / (-at_end + std::sqrt(root));
}

// Where g jumps at a point of the grid and M leaves y to the dynamics: the state has to follow g there, with y of its
// own kind, and not within the step before. The step ends with two brief parts, one for the impulse and one after it.
class JumpsAtPoints {
 public:
  explicit JumpsAtPoints(const DiscreteProblem& p) : p_(p) {
    if (!p.sources || !p.scene.g || takes_limits_at_points(p)) return;
    g_.emplace(p.scene.g, p.scene.constraints(), p.sources->resolution);
    scale_ = p.g.table().cwiseAbs().maxCoeff();
  }

  // `ends`: of the parts of step j, the last of which is its point.
  bool divide(Index j, std::vector<double>& ends) {
    const double from = ends.size() > 1 ? ends[ends.size() - 2] : p_.t[j - 1], to = ends.back(), part = brief * p_.h;
    if (!jumps(j, to - from) || !(to - from > 4 * part)) return false;
    ends.insert(ends.end() - 1, {to - 2 * part, to - part});
    return true;
  }

  // At the end of step j, whose last part has this length.
  bool jumps(Index j, double length) {
    if (!g_ || !p_.sources->at(j)) return false;
    Vector own;
    g_->value(p_.t[j], own);
    return (own - g_->before(p_.t[j], length)).cwiseAbs().maxCoeff() > same_at_end * scale_;
  }

 private:
  const DiscreteProblem& p_;
  std::optional<OneSided> g_;
  double scale_ = 0;
};

// The grid of a march in stages while it is filled part by part.
class GrowingGrid {
 public:
  explicit GrowingGrid(double start) : t_{start} { grid_.step = grid_.at = {0}; }

  double end() const { return t_.back(); }

  void add(Index step, const DyadicPart& part) {
    grid_.lengths.push_back(part.length);
    grid_.from.push_back(part.from);
    grid_.to.push_back(part.to);
    t_.push_back(part.end);
    grid_.step.push_back(step);
  }

  // `jump`: the last two parts are brief ones, for a jump of g at the grid point.
  void end_step(bool jump) {
    grid_.at.push_back(Index(t_.size()) - 1);
    if (jump) grid_.after.insert(grid_.after.end(), {grid_.at.back() - 1, grid_.at.back()});
  }

  StageGrid take() {
    grid_.t = Eigen::Map<const Vector>(t_.data(), Index(t_.size()));
    return std::move(grid_);
  }

 private:
  StageGrid grid_;
  std::vector<double> t_;
};

StageGrid steps_in_parts(const DiscreteProblem& p, Layers& layers, const Contacts& contacts) {
  GrowingGrid grid(p.t[0]);
  JumpsAtPoints jumps(p);
  std::vector<double> ends;
  for (Index j = 1; j <= p.J; ++j) {
    const RoughStep* rough = p.sources ? p.sources->at(j) : nullptr;
    ends.clear();
    double from = p.t[j - 1];
    for (std::size_t k = 0; k < (rough ? rough->ends.size() : 1); ++k) {
      const double end = rough && k + 1 < rough->ends.size() ? rough->ends[k] : p.t[j];
      layers.divide(from, end, ends);
      from = end;
    }
    if (const auto contact = contacts.find(j); contact != contacts.end())
      divide_contact(contact->second, p.t[j - 1], p.h, ends);
    const bool jump = jumps.divide(j, ends);
    for (const double end : ends) {
      const double begin = grid.end();
      grid.add(j, {end, ends.size() == 1 ? p.h : end - begin, begin, end});
    }
    grid.end_step(jump);
  }
  return grid.take();
}

// The same with parts of few lengths.
StageGrid steps_in_dyadic_parts(const DiscreteProblem& p, LayersOf layers, const Contacts& contacts) {
  GrowingGrid grid(p.t[0]);
  JumpsAtPoints jumps(p);
  const bool all = layers == LayersOf::all_jumps;
  DyadicParts parts(p, all || layers == LayersOf::impulses_and_start, all);
  for (Index j = 1; j <= p.J; ++j) {
    std::vector<double> more;
    if (const auto contact = contacts.find(j); contact != contacts.end()) {
      more.push_back(p.t[j]);
      divide_contact(contact->second, p.t[j - 1], p.h, more);
      more.pop_back();
    }
    const bool jump = jumps.jumps(j, p.h);
    for (const DyadicPart& part : parts.of(j, more, jump)) grid.add(j, part);
    grid.end_step(jump);
  }
  return grid.take();
}

}  // namespace

bool takes_limits_at_points(const DiscreteProblem& p) { return has_one_solution(p.lcp_class); }

StageGrid make_grid(const DiscreteProblem& p, Index stages, LayersOf layers_of, const Contacts& contacts) {
  if (stages == 1) return whole_steps(p);
  const bool impulse_at_start = layers_of == LayersOf::impulses_and_start;
  if (!p.small_state())
    return p.sources || impulse_at_start ? steps_in_dyadic_parts(p, layers_of, contacts) : whole_steps(p);
  Layers layers(p, layers_of);
  if (!p.sources && layers.none()) return whole_steps(p);
  return steps_in_parts(p, layers, contacts);
}

Contacts contacts_of(const StageGrid& grid, const StageSolution& s, const RowMatrix& g) {
  Contacts contacts;
  if (grid.lengths.empty()) return contacts;
  const Index n = s.y.cols();
  for (const Index row : s.impacts) {
    const auto [place, added] = contacts.try_emplace(grid.step[std::size_t(row)], NAN);
    if (!added || row < 4) continue;
    const RowMatrix w = s.v.middleRows(row - 3, 3) + g.block(row - 3, g.cols() - n, 3, n);
    for (Index i = 0; i < n; ++i) {
      if (!(s.y(row, i) > 0) || (s.y.col(i).segment(row - 3, 3).array() > 0).any()) continue;
      const double t = predicted_root(grid.t.segment(row - 3, 3), w.col(i));
      if (!(t >= place->second)) place->second = t;
    }
  }
  return contacts.size() <= most_contacts ? contacts : Contacts();
}

}  // namespace bromwich
