// Pseudo-arclength continuation of periodic states on located events.
//
// Between two states of a branch the form of the orbit, the sign of t_p and the number of multipliers outside of the
// unit circle may change. The place is found by halving. Where the form changes, F has another piece: the branch has a
// corner there (di Bernardo, Budd, Champneys & Kowalczyk 2008), and may turn by any angle. If it turns back, steps
// along its tangent lead nowhere, and the tangents of the other pieces of F around the corner are tried.

#include "bromwich/continuation.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/shooting/branch_steps.hpp"
#include "core/shooting/located_shooting.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

namespace bromwich {

namespace {

constexpr double shortest = 1e-7, place = 1e-6;  ///< steps, and the rest of a step in which a mark lies
constexpr double first_step = 0.1;               ///< of the longest
constexpr double longer = 1.5;                   ///< steps, after few of Newton's method
constexpr int few_newton = 3;
constexpr double most_turn = 0.3;     ///< angle between the tangents of two states of one form
constexpr double stays = 0.7;         ///< of the angle, in half of the step: it is that of a corner
constexpr double farthest = 3;        ///< of the length of a step: the next state
constexpr double same_change = 1e-3;  ///< of D: at a place where the form changes, and F does not

Index growing_of(const BranchState& s) { return growing(multipliers_of(s.orbit.D)); }

double by_p(const BranchState& s) { return s.tangent[s.tangent.size() - 1]; }

double distance(const BranchState& a, const BranchState& b) {
  return (place_of(b.orbit) - place_of(a.orbit)).cwiseQuotient(a.scale).norm();
}

class Continuation {
 public:
  Continuation(const std::function<Scene(double)>& scene_of, double from, double to, const ContinuationOptions& options)
      : options_(options), from_(from), to_(to), orbits_(scene_of, from, to, options), steps_(orbits_) {}

  Branch run() {
    if (begin()) follow();
    branch_.integrations = orbits_.integrations();
    return std::move(branch_);
  }

 private:
  using Alike = std::function<bool(const BranchState&)>;

  struct Bracket {
    BranchState last;                   ///< that is alike
    std::optional<BranchState> beyond;  ///< the next one that is not; none: Newton's method finds none
    double apart;                       ///< the length of the step between
  };

  bool end(const std::string& why) {
    branch_.reason = why;
    return false;
  }

  bool begin() {
    auto orbit = orbits_.first();
    if (!orbit) return end(orbits_.why());
    const Vector towards = (to_ > from_ ? 1 : -1) * Vector::Unit(orbit->x0.size() + 1, orbit->x0.size());
    auto state = steps_.first(std::move(*orbit), towards);
    if (!state) return end(orbits_.why());
    now_ = std::move(*state);
    branch_.points.push_back(point_of(now_.orbit));
    growing_ = growing_of(now_);
    return true;
  }

  bool follow() {
    double h = first_step * options_.longest_step;
    while (Index(branch_.points.size()) < options_.max_points) {
      if (orbits_.interrupted()) return end("it was interrupted");
      bool last = false;
      auto next = ahead(h, last);
      if (!next || next->orbit.form != now_.orbit.form) {
        if (next ? pass_corner(next, h) : h <= shortest && pass_corner(next, h)) continue;
        if (h <= shortest) return end(text("the branch was lost at %.6g", now_.orbit.p));
        h /= 2;
        continue;
      }
      const bool easy = next->newton <= few_newton;
      pass(std::move(*next), h);
      if (last) return branch_.complete = true;
      if (easy) h = std::min(longer * h, options_.longest_step);
    }
    return end(text("it has more than %ld points", long(options_.max_points)));
  }

  // The state after a step of length h along the tangent, or at the end of the interval.
  std::optional<BranchState> ahead(double h, bool& last) {
    const double p = now_.orbit.p + h * now_.scale.tail(1)[0] * by_p(now_);
    last = !orbits_.inside(p);
    auto next = last ? steps_.at_parameter(now_, by_p(now_) > 0 ? std::max(from_, to_) : std::min(from_, to_))
                     : steps_.next(now_, h);
    if (!next || distance(now_, *next) > farthest * h) return std::nullopt;
    // Of a smooth branch the angle falls with the step; at a corner it stays.
    const double turn = std::acos(std::clamp(next->tangent.dot(now_.tangent), -1.0, 1.0)), before = turn_;
    turn_ = turn;
    if (next->orbit.form == now_.orbit.form && turn > most_turn && turn < stays * before) return std::nullopt;
    return next;
  }

  // Halves the step behind `last` until it is short.
  Bracket narrow(BranchState last, std::optional<BranchState> beyond, double h, const Alike& alike) {
    double apart = h;
    while (h > place) {
      h /= 2;
      auto middle = steps_.next(last, h);
      if (middle && distance(last, *middle) > farthest * h) middle.reset();
      if (middle && alike(*middle)) {
        last = std::move(*middle);
        apart -= h;
      } else if (middle) {
        beyond = std::move(middle);
        apart = h;
      }
    }
    return {std::move(last), std::move(beyond), apart};
  }

  void mark(BranchEvent event, const Orbit& at, Index component = -1) {
    branch_.marks.push_back({event, at.p, at.x0, Index(branch_.points.size()) - 1, component});
  }

  // To a state of the same form.
  void pass(BranchState next, double h) {
    const Index before = growing_;
    growing_ = growing_of(next);
    const bool turns = by_p(now_) * by_p(next) < 0;
    if (turns) {
      const double side = by_p(now_);
      mark(BranchEvent::fold,
           narrow(now_, next, h, [side](const BranchState& s) { return by_p(s) * side > 0; }).last.orbit);
    } else if (growing_ != before) {
      const Bracket b = narrow(now_, next, h, [before](const BranchState& s) { return growing_of(s) == before; });
      mark(passed(b.last.orbit, growing_ - before), b.last.orbit);
    }
    take(std::move(next));
  }

  void take(BranchState next) {
    turn_ = INFINITY;
    now_ = std::move(next);
    branch_.points.push_back(point_of(now_.orbit));
  }

  // What the multipliers nearest to the unit circle do.
  static BranchEvent passed(const Orbit& at, Index change) {
    const std::vector<Complex> all = multipliers_of(at.D);
    const Complex nearest = *std::min_element(all.begin(), all.end(), [](Complex a, Complex b) {
      return std::abs(std::abs(a) - 1) < std::abs(std::abs(b) - 1);
    });
    if (change % 2 == 0 && nearest.imag() != 0) return BranchEvent::torus;
    return nearest.real() < 0 ? BranchEvent::period_doubling : BranchEvent::branching;
  }

  // To the place where the form changes, and on from there. False: there is none, or the branch ends.
  bool pass_corner(const std::optional<BranchState>& far, double h) {
    const OrbitForm form = now_.orbit.form;
    Bracket b = narrow(now_, far, h, [&](const BranchState& s) { return s.orbit.form == form; });
    if (distance(now_, b.last) > place) pass(b.last, distance(now_, b.last));
    if (b.beyond && distance(now_, *b.beyond) > farthest * std::max(b.apart, place)) b.beyond.reset();
    // Newton's method may lead to another branch over a step that is too long.
    auto short_step = steps_.next(now_, 2 * place);
    if (short_step && short_step->orbit.form == form) return false;
    if (short_step && distance(now_, *short_step) <= 2 * farthest * place) b.beyond = std::move(short_step);
    std::optional<BranchState> place_of_corner;
    if (!b.beyond && (b.beyond = turned())) place_of_corner = seen_from(*b.beyond);
    if (!b.beyond) return false;
    if ((now_.orbit.D - b.beyond->orbit.D).norm() > same_change * now_.orbit.D.norm()) {
      // Beside a grazing F is smooth on one side alone, and places are known best from there.
      const bool behind = place_of_corner && place_of_corner->orbit.D.norm() < now_.orbit.D.norm();
      const Orbit& at = behind ? place_of_corner->orbit : now_.orbit;
      mark(BranchEvent::grazing, at, changed(form, b.beyond->orbit.form));
      if (by_p(now_) * by_p(*b.beyond) < 0) mark(BranchEvent::fold, at);
    }
    growing_ = growing_of(*b.beyond);
    take(std::move(*b.beyond));
    return true;
  }

  static Index changed(const OrbitForm& a, const OrbitForm& b) {
    return Index(std::mismatch(a.begin(), a.end(), b.begin()).first - a.begin());
  }

  std::optional<BranchState> turned() {
    for (const double length : {1e-4, 1e-3}) {
      auto next = steps_.turned(now_, length);
      if (next && distance(now_, *next) <= farthest * length) return next;
    }
    return std::nullopt;
  }

  // The corner behind a state that has just turned there.
  BranchState seen_from(BranchState s) {
    const OrbitForm form = s.orbit.form;
    s.tangent = -s.tangent;
    const double length = 4 * distance(s, now_);
    return narrow(std::move(s), {}, length, [&](const BranchState& b) { return b.orbit.form == form; }).last;
  }

  const ContinuationOptions& options_;
  const double from_, to_;
  Orbits orbits_;
  BranchSteps steps_;
  BranchState now_;
  double turn_ = INFINITY;  ///< angle of the last step that was tried
  Index growing_ = 0;       ///< multipliers of `now_` outside of the unit circle
  Branch branch_;
};

}  // namespace

const char* to_string(BranchEvent event) {
  switch (event) {
    case BranchEvent::fold:
      return "fold";
    case BranchEvent::grazing:
      return "grazing";
    case BranchEvent::period_doubling:
      return "period-doubling";
    case BranchEvent::torus:
      return "torus";
    default:
      return "branching";
  }
}

Branch continuation(const std::function<Scene(double)>& scene_of, double start, double end,
                    const ContinuationOptions& options) {
  if (!std::isfinite(start) || !std::isfinite(end) || start == end)
    throw Error("end", text("found an interval from %g to %g", start, end), "give two different numbers");
  if (!(options.longest_step > 0 && options.longest_step <= 1))
    throw Error("longest_step", text("found %g", options.longest_step), "give a number above 0, at most 1");
  if (!(options.tolerance > 0 && options.tolerance < 1))
    throw Error("tolerance", text("found %g", options.tolerance), "give a number between 0 and 1");
  if (options.max_points < 1) throw Error("max_points", "is below 1", "give at least 1");
  return Continuation(scene_of, start, end, options).run();
}

}  // namespace bromwich
