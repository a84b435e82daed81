#include "core/events/event_driven.hpp"

#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/events/regime_steps.hpp"
#include "core/kernel/start_rounding.hpp"
#include "core/scene/scene.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

namespace bromwich {

namespace {

constexpr Index most_states = 96, most_constraints = 72;
constexpr int idle_events = 40;      ///< events within a short time that count as accumulated
constexpr double idle_share = 1e-7;  ///< of T: that time
constexpr int most_accumulations = 200;
constexpr int most_changes_at_once = 32;
constexpr const char* lost_sign = "terms of y cancel so far that rounding decides its sign";
constexpr std::size_t most_stored = 60000000;  ///< numbers in the pieces

class EventIntegration {
  static constexpr Index s = Collocation::degree;

 public:
  EventIntegration(const Scene& scene, LcpClass lcp_class, const std::vector<double>& breakpoints,
                   const EventOptions& o)
      : scene_(scene),
        breakpoints_(breakpoints),
        options_(o),
        T_(scene.T),
        longest_(o.longest_step > 0 ? o.longest_step : T_ / 64),
        m_(scene.states()),
        n_(scene.constraints()),
        regimes_(o.kept ? o.kept : keep_regimes()) {
    regimes_->begin(scene, lcp_class, {longest_span(breakpoints, T_), o.tolerance, longest_});
    regime_ = &regimes_->of(scene.x0);
    const Vector of_x = Vector::Zero(m_), of_y = Vector::Zero(n_);
    at_.sizes.u = {of_x, of_x, of_x, of_y, of_y, of_y};
    at_.h = regime_->steps.usual_length();
    at_.x = scene.x0;
    for (std::size_t k = 0; k < scene.memories.size(); ++k) at_.x[scene.memories[k].state] = double(regime_->modes[k]);
    at_.sizes.u.f = regime_->sources.f(0).cwiseAbs();
    // Of a component that another solve has left as rounding x0 says nothing.
    at_.sizes.include_x(
        terms_of_motion(regime_->system.A, Matrix::Identity(m_, m_), at_.x, at_.sizes.u.f, of_x, at_.h));
    put_on_constraints();
    at_.y = at_.integral = at_.sizes.y = solution_.doubt = of_y;
  }

  EventSolution run() {
    expect_motion();
    if (!note_regime()) return std::move(solution_);
    std::vector<double> ends;
    for (const double t : breakpoints_)
      if (t > 0 && t < T_) ends.push_back(t);
    solution_.breakpoints = Index(ends.size());
    ends.push_back(T_);
    solution_.complete = std::all_of(ends.begin(), ends.end(), [this](double end) { return advance_to(end); });
    solution_.until = at_.t;
    solution_.work = at_.work;
    return std::move(solution_);
  }

 private:
  // False where no solution of the regime is selected.
  bool note_regime() {
    solution_.unique = solution_.unique && (regime_->unique || regime_->enumerates);
    if (!regime_->open) return true;
    solution_.reason = "the complementarity problem of a short step is not of class P";
    return false;
  }

  // The sizes of a state that y has not moved yet: those that y of a first step gives it. An x0 that is small beside
  // them counts as zero, as it would later.
  void expect_motion() {
    const ShortSteps::Step first = regime_->short_steps.take(0, at_.h, at_.x, Vector::Zero(n_));
    if (first.solved && first.y.allFinite()) at_.sizes.include_x(regime_->steps.moved_within_step(first.y.cwiseAbs()));
  }

  // Constraints on the state alone that x0 meets but for rounding: the smallest change of x0 that meets them, each
  // component relative to its size.
  void put_on_constraints() {
    const SystemMatrices& system = regime_->system;
    Vector g = Vector::Zero(n_);
    for (int k = 0; k <= 8; ++k) g = g.cwiseMax(regime_->sources.g(T_ * k / 8).cwiseAbs());
    const Vector w = system.N * at_.x + regime_->sources.g(0), f = regime_->sources.f(0);
    const Vector terms = terms_of_motion(system.A, system.N, at_.x, f, g, T_);
    std::vector<Index> rows;
    for (Index i = 0; i < n_; ++i)
      if (std::abs(w[i]) <= rounding_of_restarts * terms[i] && system.M.row(i).isZero(0)) rows.push_back(i);
    if (rows.empty()) return;
    const Vector size = terms_of_motion(system.A, Matrix::Identity(m_, m_), at_.x, f, Vector::Zero(m_), T_);
    const Matrix N = system.N(rows, Eigen::all) * size.asDiagonal();
    at_.x -= size.cwiseProduct(Eigen::CompleteOrthogonalDecomposition<Matrix>(N).solve(Vector(w(rows))));
  }

  bool give_up(const std::string& why, EventEnd end = EventEnd::other) {
    solution_.end = end;
    solution_.reason = why + text(" at t = %.6g", at_.t);
    return false;
  }

  bool advance_to(double end) {
    at_.end = end;
    if (!is_wanted()) return false;
    if (end - at_.t > 4 * epsilon * T_)
      return continue_as_before(mode_ ? std::optional(mode_->active) : std::nullopt, -1) && run_segment();
    at_.t = end;  // edges that differ by rounding alone
    return true;
  }

  // What has followed this set and the one before it, at a breakpoint or at this event, is likely to follow again.
  bool continue_as_before(std::optional<std::vector<Index>> likely, Index event) {
    const Passage here{regime_, earlier_, mode_, event};
    if (const auto known = followers_.find(here); known != followers_.end()) likely = known->second->active;
    earlier_ = mode_;
    if (!continue_with(likely, event >= 0)) return false;
    if (regime_ == std::get<0>(here)) followers_[here] = mode_;
    return true;
  }

  // Chooses the active set after an event or a breakpoint, and takes its first step.
  bool continue_with(const std::optional<std::vector<Index>>& likely, bool y_is_known) {
    const double t = at_.t;
    std::vector<Index> set;
    EventPoint& here = here_ = at_;
    Successor::Choice next = choose(likely, y_is_known);
    for (int k = 0; next.mode && change_modes(*next.mode, here, set); ++k) {
      if (k == most_changes_at_once) return give_up("modes with memory change without end");
      at_ = here;
      regime_ = &regimes_->of(at_.x);
      if (!note_regime()) return false;
      next = choose(pairs_of(next.mode->active), false);
    }
    if (!next.unique && regime_->enumerates)
      return give_up("the solution is not unique: two active sets continue it differently",
                     EventEnd::several_solutions);
    if (!next.mode) return pass_unknown();
    unknown_ = 0;
    mode_ = next.mode;
    for (const EventImpulse& impulse : next.impulses) note_impulse(impulse.p);
    if (t > 0) note_jump_of_y(here.y, *next.step);
    if (t > 0 && !set.empty()) solution_.continuous = false;
    accept(*next.step);
    solution_.pieces.back().impulses = next.impulses;
    solution_.pieces.back().set = std::move(set);
    pending_event_ = next.step->valid < 1 ? next.step->event : -1;
    return true;
  }

  Successor::Choice choose(const std::optional<std::vector<Index>>& likely, bool y_is_known) {
    Successor& successor = regime_->successor;
    const EventPoint& here = chosen_from_ = at_;
    Successor::Choice next =
        regime_->enumerates ? successor.choose_among_all(at_) : successor.choose(at_, y_is_known, likely);
    if (!next.mode && !regime_->enumerates && n_ <= Successor::most_enumerated) {
      at_ = here;
      next = successor.choose_among_all(at_);
    }
    if (!next.mode && !regime_->enumerates) {
      at_ = here;
      next = successor.choose_brief(at_);
    }
    return next;
  }

  // An active set without the guards, which other modes of memories do not have.
  std::vector<Index> pairs_of(std::vector<Index> active) const {
    if (!regime_->modes.empty()) std::erase_if(active, [this](Index i) { return i >= regime_->system.pairs(); });
    return active;
  }

  // Of memories whose guards the active set finds below 0. False: none changes the state.
  bool change_modes(const SwitchedMode& mode, EventPoint& p, std::vector<Index>& done) const {
    constexpr double same = 1e-6;
    bool any = false;
    const auto set = [&](Index state, double value) {
      double& x = p.x[state];
      if (std::abs(x - value) <= same * std::max(std::abs(x), std::abs(value))) return;
      x = value;
      done.push_back(state);
      any = true;
    };
    const auto holds = [&](Index guard) { return std::binary_search(mode.active.begin(), mode.active.end(), guard); };
    for (std::size_t k = 0; k < scene_.memories.size(); ++k) {
      const Memory& memory = scene_.memories[k];
      for (const Memory::Leave& leave : memory.modes[std::size_t(regime_->modes[k])].leave) {
        if (!std::all_of(leave.when.begin(), leave.when.end(), [&](const auto& c) { return holds(c.guard); })) continue;
        set(memory.state, double(mode_named(memory, leave.to)));
        for (const Memory::Jump& jump : leave.set) set(jump.state, jump.value);
        break;
      }
    }
    return any;
  }

  void note_impulse(const Vector& impulse) {
    ++solution_.jumps;
    if (at_.t > 0) return void(solution_.continuous = false);
    if (solution_.jump_at_start.size() == 0) solution_.jump_at_start = Vector::Zero(n_);
    solution_.jump_at_start += impulse;
  }

  // y from the left and the first value of the next step.
  void note_jump_of_y(const Vector& before, const EventStep& step) {
    if (n_ == 0) return;
    const Vector after = step.y.transpose() * legendre(0);
    const double size = std::max(at_.sizes.y.maxCoeff(), step.y.cwiseAbs().colwise().sum().maxCoeff());
    if ((after - before).cwiseAbs().maxCoeff() > 1e-6 * size) solution_.continuous = false;
  }

  void accept(const EventStep& step) {
    const double end = step.valid >= 1 ? at_.t + step.length : at_.t + step.valid * step.length;
    const double to = at_.end - end < 4 * epsilon * T_ ? at_.end : end;
    solution_.pieces.push_back({at_.t, step.length, to, step.x, step.y, at_.integral, mode_->active});
    solution_.pieces.back().modes = regime_->modes;
    if (step.valid < 1) solution_.pieces.back().event = step.event;
    stored_ += std::size_t((s + 1) * (m_ + n_));
    at_.sizes.include(step);
    solution_.defect = std::max(solution_.defect, step.defect);
    solution_.doubt = solution_.doubt.cwiseMax(step.doubt);
    const Vector values = legendre(step.valid);
    at_.x = step.x.transpose() * values;
    at_.y = step.y.transpose() * values;
    at_.zero_y = step.zero_y;
    at_.zero_w = step.zero_w;
    at_.integral += step.length * (step.y.transpose() * legendre_integrals(step.valid));
    at_.t = to;
    propose_length(step);
  }

  // Values behind an event say nothing of the solution: a step does not reach far beyond the next one.
  void propose_length(const EventStep& step) {
    constexpr double beyond = 4;
    if (step.valid < 1)
      return void(at_.h = std::min(at_.h, std::max(beyond * step.valid * step.length, regime_->steps.usual_length())));
    if (step.shortened) at_.h = step.length;
    if (const double room = regime_->steps.room(step); room > 1.3)
      at_.h = std::min(longest_, std::max(at_.h, step.length * room));
  }

  // The present active set without the component of the event, or with it.
  std::vector<Index> exchanged(Index i) const {
    std::vector<Index> set = mode_->active;
    const auto place = std::lower_bound(set.begin(), set.end(), i);
    if (place != set.end() && *place == i)
      set.erase(place);
    else
      set.insert(place, i);
    return set;
  }

  bool pass_accumulation() {
    const bool passed = ++solution_.accumulations <= most_accumulations && pass(10 * options_.tolerance * T_);
    return passed || give_up("events accumulate");
  }

  // Where a kink of a source is known to less than full precision, no active set holds on both sides of it. Steps of
  // implicit Euler pass it, each ten times as long as the one before.
  bool pass_unknown() {
    const Vector before = at_.x;
    const double h = 10 * options_.tolerance * T_ * std::pow(10.0, unknown_);
    const bool passed =
        !regime_->enumerates && at_.t > 0 && ++unknown_ <= most_unknown && h <= longest_unknown * T_ && pass(h);
    const auto moves_little = [&] {
      const Vector size = at_.sizes.u.x.cwiseMax(before.cwiseAbs());
      return (at_.x - before).cwiseAbs().maxCoeff() <= moved_unknown * size.maxCoeff();
    };
    if (!passed || !moves_little())
      return give_up(regime_->steps.sign_is_lost() ? lost_sign : "no active set was found that continues the solution");
    return continue_with({}, false);
  }
  static constexpr int most_unknown = 5;
  static constexpr double longest_unknown = 1e-7;  ///< of T
  static constexpr double moved_unknown = 1e-5;    ///< of the state: more is a jump

  // A short step of implicit Euler, or, where the set of its y holds at its end, of that set: signs within it are lost.
  bool pass(double longest) {
    const double h = std::min(longest, 0.5 * (at_.end - at_.t));
    const ShortSteps::Step step = regime_->short_steps.take(at_.t, h, at_.x, Vector::Zero(n_));
    if (!step.solved) return false;
    EventPiece piece{at_.t, h, at_.t + h, Matrix::Zero(s + 1, m_), Matrix::Zero(s + 1, n_), at_.integral};
    if (EventPoint here = at_; regime_->successor.pass(support_of(step.y), h, here, step_)) {
      piece.x = step_.x, piece.y = step_.y;
    } else {
      piece.x.topRows(2) << (at_.x + step.x).transpose() / 2, (step.x - at_.x).transpose() / 2;
      piece.y.row(0) = step.y.transpose();
    }
    piece.passed = true, piece.modes = regime_->modes;
    solution_.pieces.push_back(piece);
    at_.x = piece.x.transpose() * legendre(1), at_.y = piece.y.transpose() * legendre(1);
    at_.zero_y.resize(0), at_.zero_w.resize(0);
    at_.integral += h * piece.y.row(0).transpose();
    at_.t += h;
    return true;
  }

  bool may_go_on() {
    if (at_.work >= allowed_)
      allowed_ = std::min(options_.most_work, options_.budget ? options_.budget(at_.work, at_.t) : INFINITY);
    if (at_.work >= allowed_ || stored_ > most_stored) return give_up("too many steps", EventEnd::out_of_work);
    if (!at_.x.allFinite()) return give_up("the solution grows without bounds");
    return is_wanted();
  }

  // Asked at every step and breakpoint: between breakpoints that are near, the first step is the only one.
  bool is_wanted() {
    if (asked_++ % 64 == 0 && options_.progress) options_.progress(at_.t);
    if (!options_.interrupted || !options_.interrupted()) return true;
    solution_.interrupted = true;
    return give_up(why_interrupted());
  }

  bool run_segment() {
    int idle = 0;
    double idle_since = at_.t;
    while (at_.t < at_.end) {
      if (!may_go_on()) return false;
      if (pending_event_ < 0 && regime_->enumerates) {
        if (!continue_with({}, true)) return false;
        continue;
      }
      if (pending_event_ < 0) {
        const auto resolves = [this] { return regime_->steps.resolve(*mode_, at_, step_); };
        if (!resolves() && (at_.h = longest_, !resolves()))  // the sign of y may be known on a longer step
          return give_up(regime_->steps.sign_is_lost() ? lost_sign : "a step could not be resolved");
        if (step_.valid > 0) accept(step_);
        if (step_.valid >= 1) continue;
        pending_event_ = solution_.pieces.back().event = step_.event;
      }
      if (!(at_.t < at_.end)) break;
      ++solution_.events;
      idle = at_.t - idle_since > idle_share * T_ ? 0 : idle + 1;
      if (idle == 0) idle_since = at_.t;
      if (idle > idle_events) {
        idle = 0;
        if (!pass_accumulation()) return false;
      }
      if (!continue_as_before(exchanged(pending_event_), pending_event_)) return false;
    }
    return true;
  }

  const Scene& scene_;
  const std::vector<double>& breakpoints_;
  const EventOptions& options_;
  const double T_, longest_;
  const Index m_, n_;
  const std::shared_ptr<RegimesOfScene> regimes_;
  RegimeSteps* regime_ = nullptr;
  EventPoint at_, here_, chosen_from_;
  EventStep step_;
  const SwitchedMode *mode_ = nullptr, *earlier_ = nullptr;  ///< now, and before the last event or breakpoint
  /// In a regime, from the two modes before, at an event of this component, or, with -1, at a breakpoint.
  using Passage = std::tuple<const RegimeSteps*, const SwitchedMode*, const SwitchedMode*, Index>;
  std::map<Passage, const SwitchedMode*> followers_;  ///< the mode that followed last
  Index pending_event_ = -1;                          ///< the component that ended the last step
  double allowed_ = 0;                                ///< work before the budget is asked again
  int unknown_ = 0;                                   ///< short steps since an active set was known
  std::size_t stored_ = 0, asked_ = 0;                ///< numbers; whether the solution is still wanted
  EventSolution solution_;
};

}  // namespace

std::string unsuited_to_events(const Scene& scene) {
  const DenseDynamics* d = scene.dynamics->small_state();
  if (scene.boundary) return "it needs initial values, and the scene has boundary values";
  if (!d || d->E.size() > 0 || scene.states() > most_states || scene.constraints() > most_constraints)
    return text("it takes dense dynamics with at most %ld states and %ld constraints", long(most_states),
                long(most_constraints));
  if (!scene.cones.empty()) return "it takes no friction on circles";
  return scene.free_rows.empty() ? "" : "it takes no free rows";
}

std::shared_ptr<RegimesOfScene> keep_regimes() { return std::make_shared<RegimesOfScene>(); }

EventSolution integrate_with_events(const Scene& scene, LcpClass lcp_class, const std::vector<double>& breakpoints,
                                    const EventOptions& options) {
  return EventIntegration(scene, lcp_class, breakpoints, options).run();
}

Vector largest_values(const EventSolution& s, Matrix EventPiece::*which) {
  Vector largest = Vector::Zero((s.pieces.front().*which).cols());
  for (const EventPiece& p : s.pieces)
    for (const double part : {0.0, 0.5, 1.0}) {
      const LegendreValues at = legendre(part * (p.end - p.begin) / p.length);
      for (Index i = 0; i < largest.size(); ++i) largest[i] = std::max(largest[i], std::abs((p.*which).col(i).dot(at)));
    }
  return largest;
}

}  // namespace bromwich
