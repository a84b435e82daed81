#pragma once
// The active set that continues a solution from an event or a breakpoint, and the impulse with which it begins.
//
// A short step of implicit Euler proposes an active set, and a step of collocation confirms it: y and w have to be
// nonnegative for some time. Where the state does not fulfil the constraints of the new active set, it jumps.

#include "../result/located_solution.hpp"
#include "event_step.hpp"
#include "short_steps.hpp"

#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

namespace bromwich {

class Successor {
 public:
  static constexpr Index most_enumerated = 6;  ///< constraints whose active sets are all tried

  /// All have to outlive the object.
  Successor(const SystemMatrices&, const EventSources&, ShortSteps&, EventSteps&, double T);

  struct Choice {
    const SwitchedMode* mode = nullptr;  ///< none: no active set was found
    const EventStep* step = nullptr;     ///< until the next one is chosen
    std::vector<EventImpulse> impulses;  ///< the jumps of the state, in their order
    bool unique = true;                  ///< false: active sets lead to different states
  };
  /// Moves x and the integral of `p` by the impulses. `y_is_known`: y of `p` is the limit from the left. `likely`:
  /// tried first.
  Choice choose(EventPoint& p, bool y_is_known, const std::optional<std::vector<Index>>& likely);
  /// Where the problems of short steps do not determine the solution: tries all active sets (n <= most_enumerated), and
  /// takes y of least norm where several lead to one state. Where none continues without a jump, the state jumps if all
  /// impulses that may be lead to one state.
  Choice choose_among_all(EventPoint& p);
  /// Where both find none: the set that `choose` saw last longest, though it ends before its event is clear of
  /// rounding.
  Choice choose_brief(EventPoint& p);
  /// A step of length h from `p` in an active set whose signs hold where it ends. False where the set has none.
  bool pass(const std::vector<Index>& set, double h, EventPoint& p, EventStep& step);

 private:
  enum class Entry { smooth, jumped, refused };
  // n values each.
  struct Impact {
    Vector e;         ///< of restitution, 0 where a bounce would be too low to be seen; empty: 0
    Vector velocity;  ///< w'
    Vector rounding;  ///< of w': smaller values are no impact
    Vector exact;     ///< likewise: smaller values are those of constraints that hold
    Vector unseen;    ///< w' of a rigid contact with which it falls back before w has risen above what counts as zero

    bool is_unseen(Index i) const { return unseen[i] > 0 && std::abs(velocity[i]) <= unseen[i]; }
  };
  // An active set that was tried, with the state after it was entered.
  struct Candidate {
    const SwitchedMode* mode = nullptr;
    double lasts = 0;
    EventStep step = {};
    Vector x = {}, integral = {};

    double mean_y() const;
    void forget() { mode = nullptr, lasts = 0; }
    void take(const SwitchedMode* of, EventStep& found, const EventPoint& p);
  };

  const SwitchedMode* mode_of(const std::vector<Index>& active);
  Vector touching(const EventPoint&, bool y_is_known) const;
  JetValues sources_at(const SwitchedMode&, const EventPoint&, JetValues& size) const;
  Impact impact_at(const EventPoint&) const;
  Vector rebounds_of_touching(const EventPoint&, const Vector& offset) const;
  std::vector<Index> zero_rows(const EventStep&) const;
  void settle(EventPoint&, bool y_is_known);
  bool may_jump(const SwitchedMode&, const JetValues& u, const Vector& zero, const Vector& impulse,
                const Vector& bounce) const;
  bool holds_behind(const SwitchedMode&, EventPoint&, const Vector& impulse);
  Entry enter(const SwitchedMode&, EventPoint&);
  std::vector<std::vector<Index>> all_sets() const;
  std::vector<Candidate> smooth_candidates(EventPoint&);
  bool jump_by_the_only_impulse(EventPoint&);
  bool lead_to_the_same(const Candidate&, const Candidate&, const EventPoint&) const;
  Entry attempt(const std::vector<Index>& set, double least, EventPoint&);
  Entry attempt_proposed(double h, const Vector& offset, EventPoint&);
  void prefer_least_norm(double h, bool y_is_known, EventPoint&);
  void prefer_least_of_all(EventPoint&);

  const SystemMatrices& system_;
  const EventSources& sources_;
  ShortSteps& short_steps_;
  EventSteps& steps_;
  double T_;
  Vector opens_;  ///< n: w_i'' by y_i of rigid contacts; 0: of others
  Matrix NAB_;
  std::map<std::vector<Index>, std::optional<SwitchedMode>> modes_;
  /// Modes whose y was that of least norm, with the other rows in which w is zero.
  std::set<std::pair<const SwitchedMode*, std::vector<Index>>> least_;
  std::set<std::vector<Index>> tried_;
  Candidate best_;   ///< that lasted longest
  Candidate brief_;  ///< likewise, of those that end at once
  EventStep tried_step_;
  bool found_ = false;  ///< it lasts long enough
  std::vector<EventImpulse> impulses_;
};

}  // namespace bromwich
