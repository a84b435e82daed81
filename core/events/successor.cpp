#include "core/events/successor.hpp"

#include "core/lcp/solution.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr int most_jumps_at_once = 12;
constexpr double brief = 1e-3;       ///< of the longest: what lasts shorter touches its end by rounding
constexpr double less_y = 1 - 1e-6;  ///< norms of y nearer to each other are equal

// Lengths of short steps are powers of two: few, whose matrices are known.
double short_length(double longest) { return std::exp2(std::floor(std::log2(longest))); }

// The step of a candidate as long as it may be.
template <class Candidate>
void lengthen(EventSteps& steps, EventPoint& p, Candidate& candidate) {
  EventPoint here = p;
  here.x = candidate.x;
  here.h = std::max(p.h, steps.usual_length());
  EventStep step;
  if (steps.resolve(*candidate.mode, here, step) && step.valid * step.length > candidate.lasts) {
    candidate.lasts = step.valid * step.length;
    candidate.step = std::move(step);
  }
  p.work = here.work;
}

}  // namespace

Successor::Successor(const SystemMatrices& system, const EventSources& sources, ShortSteps& short_steps,
                     EventSteps& steps, double T)
    : system_(system),
      sources_(sources),
      short_steps_(short_steps),
      steps_(steps),
      T_(T),
      opens_(openings(system)),
      NAB_(system.N * system.A * system.B) {}

const SwitchedMode* Successor::mode_of(const std::vector<Index>& active) {
  auto known = modes_.find(active);
  if (known == modes_.end()) known = modes_.emplace(active, make_switched_mode(system_, active)).first;
  return known->second ? &*known->second : nullptr;
}

// What w lacks to 0 on constraints that the state touches: rounding, and the error of the time of the event.
Vector Successor::touching(const EventPoint& p, bool y_is_known) const {
  const Vector g = sources_.g(p.t + 1e-15 * T_);
  const Vector w = system_.N * p.x + system_.M * p.y + g;
  const Vector of_w = system_.N.cwiseAbs() * p.sizes.u.x.cwiseMax(p.x.cwiseAbs()) +
                      system_.M.cwiseAbs() * p.y.cwiseAbs() + p.sizes.u.g.cwiseMax(g.cwiseAbs());
  const Vector rounding = system_.N.cwiseAbs() * steps_.rounding_of_x(p.sizes);
  Vector offset = Vector::Zero(w.size());
  for (Index i = 0; i < w.size(); ++i) {
    const bool depends = system_.M.row(i).cwiseAbs().maxCoeff() > 0;
    const bool known = y_is_known && p.zero_w.size() > 0;
    const double zero = known ? 10 * p.zero_w[i] : 10 * steps_.noise() * of_w[i] + rounding[i];
    if ((!depends || y_is_known) && std::abs(w[i]) <= zero) offset[i] = w[i];
  }
  return offset;
}

// Tries an active set from here: it is found if it lasts.
Successor::Entry Successor::attempt(const std::vector<Index>& set, double least, EventPoint& p) {
  const SwitchedMode* mode = mode_of(set);
  if (!mode) return Entry::refused;
  const Vector x = p.x, integral = p.integral;
  const Entry entry = enter(*mode, p);
  if (entry != Entry::smooth) return entry;
  if (EventStep& next = tried_step_; steps_.resolve_first(*mode, p, next)) {
    const double lasts = next.valid * next.length;
    found_ = next.valid >= 1 || (lasts >= least && !next.at_once);
    if (found_ || (lasts > best_.lasts && !next.at_once))
      best_.take(mode, next, p);
    else if (impulses_.empty() && lasts > brief_.lasts)
      brief_.take(mode, next, p);
  }
  p.x = x;
  p.integral = integral;
  return entry;
}

// Tries the active sets that short steps of implicit Euler propose.
Successor::Entry Successor::attempt_proposed(double h, const Vector& offset, EventPoint& p) {
  static constexpr std::array<double, 6> shares{1e-3, 1e-5, 1e-2, 1e-7, 1e-1, 1e-9};
  const double m = double(system_.states()), n = double(system_.constraints());
  const Vector rebounds = rebounds_of_touching(p, offset);
  for (const double share : shares) {
    const double length = short_length(share * h);
    const ShortSteps::Step proposed = short_steps_.take(p.t, length, p.x, offset - length * rebounds);
    p.work += m * m * m + n * n * n;
    if (!proposed.y.allFinite()) continue;
    // Where w_i and y_i vanish, w_i = 0 may be what determines another y. Where large terms cancel, rounding may keep
    // the solver from its aim; the sets that it comes to are tried all the same.
    for (int k = 0; k < (proposed.solved ? 3 : 2); ++k) {
      const std::vector<Index> set = k == 0 ? support_of(proposed.y) : k == 1 ? proposed.basis() : proposed.zero_w;
      if (!tried_.insert(set).second) continue;
      const Entry entry = attempt(set, 0.5 * length, p);
      if (found_ || entry == Entry::jumped) return entry;
    }
  }
  return Entry::refused;
}

// Rows that are zero on a step, those of the active set included.
std::vector<Index> Successor::zero_rows(const EventStep& step) const {
  std::vector<Index> rows;
  for (Index i = 0; i < system_.constraints(); ++i)
    if (step.w.col(i).cwiseAbs().sum() <= step.zero_w[i]) rows.push_back(i);
  return rows;
}

// Where y is not unique, the set of the y of least norm of a short step, if it lasts and leads to the same state. What
// is compared are steps as long as they may be: on shorter ones different solutions look alike.
void Successor::prefer_least_norm(double h, bool y_is_known, EventPoint& p) {
  constexpr double share = 1e-3;
  const auto found = std::pair(best_.mode, zero_rows(best_.step));
  if (least_.contains(found)) return;
  const double length = short_length(share * h);
  const ShortSteps::Step proposed = short_steps_.take(p.t, length, p.x, touching(p, y_is_known));
  if (!proposed.solved || !proposed.y.allFinite()) return;
  const std::vector<Index> set = support_of(proposed.y);
  if (set == best_.mode->active) least_.insert(found);
  if (!tried_.insert(set).second) return;
  const SwitchedMode* mode = mode_of(set);
  const std::size_t impulses = impulses_.size();
  EventPoint here = p;
  here.h = std::max(p.h, steps_.usual_length());
  EventStep step;
  const bool smooth = mode && enter(*mode, here) == Entry::smooth && steps_.resolve(*mode, here, step);
  p.work = here.work;
  impulses_.resize(impulses);
  const double lasts = step.valid * step.length;
  if (!smooth || !(step.valid >= 1 || (lasts >= 0.5 * length && !step.at_once))) return;
  Candidate other{mode, lasts, std::move(step), here.x, here.integral};
  lengthen(steps_, p, best_);
  if (other.mean_y() < less_y * best_.mean_y() && lead_to_the_same(other, best_, p)) best_ = std::move(other);
}

// The same among all active sets.
void Successor::prefer_least_of_all(EventPoint& p) {
  if (!best_.mode || system_.constraints() > most_enumerated) return;
  const auto found = std::pair(best_.mode, zero_rows(best_.step));
  if (least_.contains(found)) return;
  lengthen(steps_, p, best_);
  for (Candidate& other : smooth_candidates(p)) {
    const bool lasts = other.lasts > brief * best_.lasts;
    if (lasts && other.mean_y() < less_y * best_.mean_y() && lead_to_the_same(other, best_, p))
      best_ = std::move(other);
  }
  if (best_.mode == found.first) least_.insert(found);
}

Successor::Choice Successor::choose_brief(EventPoint& p) {
  if (!(brief_.lasts > 4 * epsilon * T_)) return {};
  p.x = brief_.x;
  p.integral = brief_.integral;
  return {brief_.mode, &brief_.step, {}};
}

bool Successor::pass(const std::vector<Index>& set, double h, EventPoint& p, EventStep& step) {
  p.end = p.t + h, p.h = h;
  const SwitchedMode* mode = mode_of(set);
  const std::size_t impulses = impulses_.size();
  const Entry entry = mode ? enter(*mode, p) : Entry::refused;
  impulses_.resize(impulses);
  const std::vector<char> free(std::size_t(system_.constraints()), 1);
  if (entry != Entry::smooth || !steps_.resolve(*mode, p, step, &free) || step.shortened) return false;
  const LegendreValues end = legendre(1);
  const Vector y = step.y.transpose() * end + step.zero_y, w = step.w.transpose() * end + step.zero_w;
  return (y.array() >= 0).all() && (w.array() >= 0).all();
}

Successor::Choice Successor::choose(EventPoint& p, bool y_is_known, const std::optional<std::vector<Index>>& likely) {
  p.sizes.include_x(p.x);
  impulses_.clear();
  brief_.forget();
  for (int jumps = 0; jumps <= most_jumps_at_once; ++jumps) {
    settle(p, y_is_known);
    const double h = steps_.longest_from(p);
    best_.forget();
    tried_.clear();
    found_ = false;
    Entry entry = Entry::refused;
    if (likely && jumps == 0) {
      tried_.insert(*likely);
      entry = attempt(*likely, 1e-3 * h, p);
    }
    if (!found_ && entry != Entry::jumped)
      entry = attempt_proposed(h, touching(p, y_is_known), p);
    else if (found_ && short_steps_.of_least_norm())
      prefer_least_norm(h, y_is_known, p);
    if (found_ && !short_steps_.determine_y() && !short_steps_.of_least_norm()) prefer_least_of_all(p);
    y_is_known = false;
    if (!found_ && entry == Entry::jumped) continue;
    // If none lasts, the next event is very near.
    if (!found_ && !(best_.lasts > 4 * epsilon * T_)) break;
    p.x = best_.x;
    p.integral = best_.integral;
    return {best_.mode, &best_.step, std::move(impulses_)};
  }
  return {};
}

// Up to the time when one of them ends.
bool Successor::lead_to_the_same(const Candidate& a, const Candidate& b, const EventPoint& p) const {
  const double common = std::min(a.lasts, b.lasts);
  const Vector off =
      a.step.x.transpose() * legendre(common / a.step.length) - b.step.x.transpose() * legendre(common / b.step.length);
  const EventSizes sizes = p.sizes.with(a.step);
  const Vector &size = sizes.u.x, rounding = steps_.rounding_of_x(sizes);
  const double share = 1e-6 + 100 * steps_.noise();
  return !((off.cwiseAbs() - share * size.cwiseMax(1e-3 * size.maxCoeff()) - rounding).array() > 0).any();
}

std::vector<std::vector<Index>> Successor::all_sets() const {
  std::vector<std::vector<Index>> sets;
  for (Index bits = 0; bits < Index(1) << system_.constraints(); ++bits) {
    std::vector<Index>& set = sets.emplace_back();
    for (Index i = 0; i < system_.constraints(); ++i)
      if (bits >> i & 1) set.push_back(i);
  }
  return sets;
}

// The impulses of all active sets after which one continues, where they lead to one state.
bool Successor::jump_by_the_only_impulse(EventPoint& p) {
  std::optional<EventPoint> after;
  EventImpulse only;
  for (const std::vector<Index>& set : all_sets()) {
    const SwitchedMode* mode = mode_of(set);
    EventPoint here = p;
    if (!mode || enter(*mode, here) != Entry::jumped) continue;
    const EventImpulse impulse = impulses_.back();
    impulses_.pop_back();
    if (smooth_candidates(here).empty()) continue;
    const double size = p.sizes.u.x.cwiseMax(here.x.cwiseAbs()).maxCoeff();
    if (after && (after->x - here.x).cwiseAbs().maxCoeff() > 1e-6 * size) return false;
    if (after) continue;
    after = std::move(here);
    only = impulse;
  }
  if (after) p = std::move(*after), impulses_.push_back(only);
  return after.has_value();
}

// Active sets that continue the solution without a jump.
std::vector<Successor::Candidate> Successor::smooth_candidates(EventPoint& p) {
  std::vector<Candidate> candidates;
  const std::size_t before = impulses_.size();
  for (const std::vector<Index>& set : all_sets()) {
    const SwitchedMode* mode = mode_of(set);
    EventPoint here = p;
    here.h = std::max(p.h, steps_.usual_length());
    EventStep step;
    const bool smooth = mode && enter(*mode, here) == Entry::smooth;
    impulses_.resize(before);
    if (!smooth || !steps_.resolve(*mode, here, step)) continue;
    const double lasts = step.valid * step.length;
    p.work = here.work;
    if (lasts > 4 * epsilon * T_ && !step.at_once)
      candidates.push_back({mode, lasts, std::move(step), here.x, here.integral});
  }
  return candidates;
}

void Successor::Candidate::take(const SwitchedMode* of, EventStep& found, const EventPoint& p) {
  mode = of;
  lasts = found.valid * found.length;
  std::swap(step, found);
  x = p.x;
  integral = p.integral;
}

// The norm of the mean of y as long as the set lasts.
double Successor::Candidate::mean_y() const {
  return (step.y.transpose() * legendre_integrals(step.valid)).norm() / step.valid;
}

Successor::Choice Successor::choose_among_all(EventPoint& p) {
  p.sizes.include_x(p.x);
  impulses_.clear();
  settle(p, false);
  std::vector<Candidate> candidates = smooth_candidates(p);
  if (candidates.empty() && jump_by_the_only_impulse(p)) candidates = smooth_candidates(p);
  if (candidates.empty()) return {};
  const auto longest = std::max_element(candidates.begin(), candidates.end(),
                                        [](const Candidate& a, const Candidate& b) { return a.lasts < b.lasts; });
  Choice choice;
  Candidate* least = &*longest;
  for (Candidate& other : candidates) {
    if (!(other.lasts > brief * longest->lasts)) continue;
    if (!lead_to_the_same(other, *longest, p)) choice.unique = false;
    if (other.mean_y() < less_y * least->mean_y()) least = &other;
  }
  best_ = std::move(*least);
  p.x = best_.x;
  p.integral = best_.integral;
  choice.mode = best_.mode;
  choice.step = &best_.step;
  choice.impulses = std::move(impulses_);
  return choice;
}

}  // namespace bromwich
