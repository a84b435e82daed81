// Initial values interval by interval, where some intervals are taken by the stages of core/galerkin/rules.hpp: the
// active set of an interval by method galerkin says which rule it needs.

#include "core/base/timer.hpp"
#include "core/galerkin/rules.hpp"
#include "core/lcp/active_set.hpp"

#include <cmath>
#include <optional>

namespace bromwich {

namespace {

// The intervals of one length by one rule.
class Stepper {
 public:
  explicit Stepper(const GalerkinStep& step) : step_(step), class_(classify(LcpMatrix(step.D))), lcp_(step.D, class_) {}

  bool solve(const GalerkinProblem& p, Index k, const Vector& x, LcpCount& count) {
    const LcpOutcome outcome = lcp_.solve(p.q.row(k).transpose() + step_.C * x, z);
    count.newton += outcome.newton;
    count.fallbacks += outcome.fallback;
    infeasible = outcome.infeasible;
    if (!outcome.solved || !z.allFinite()) return false;
    after = step_.E * x + step_.H * z + p.forcing.row(k).transpose();
    return after.allFinite();
  }
  LcpClass lcp_class() const { return class_; }

  Vector z, after;
  bool infeasible = false;

 private:
  const GalerkinStep& step_;
  LcpClass class_;
  ActiveSetLcp lcp_;
};

class RuledMarch {
 public:
  RuledMarch(const ReducedProblems& problems, RuleChoice& choice, const Options& options)
      : problems_(problems), choice_(choice), options_(options), p_(problems.galerkin.reduced()) {}

  GalerkinSolution run(std::vector<IntervalRule>& rules) {
    Timer timer;
    GalerkinSolution s;
    s.how = "interval by interval";
    s.iterations = 1;
    s.unique = true;
    s.z = RowMatrix::Constant(p_.N, p_.unknowns(), NAN);
    s.x = RowMatrix::Constant(p_.N + 1, p_.states(), NAN);
    s.x.row(0) = p_.boundary.b.transpose();
    rules.assign(std::size_t(p_.N), IntervalRule::galerkin);
    for (Index k = 0; k < p_.N; ++k) {
      if (k % polled_every == 0 && asked_to_stop(k, s)) return s;
      if (k == first_behind_run()) next_run();
      const Vector x = s.x.row(k).transpose();
      const std::optional<IntervalRule> rule = take(k, x, s);
      if (!rule) return unsolved(k, s);
      rules[std::size_t(k)] = *rule;
      const Stepper& taken = by(*rule);
      s.unique = s.unique && has_one_solution(taken.lcp_class());
      s.z.row(k) = taken.z.transpose();
      s.x.row(k + 1) = taken.after.transpose();
      ++s.lcp.solved;
    }
    s.status = Status::solved;
    s.lcp_seconds = timer.lap();
    return s;
  }

 private:
  static constexpr Index polled_every = 64;

  Index first_behind_run() const {
    return run_ < 0 ? 0 : p_.runs[std::size_t(run_)].first + p_.runs[std::size_t(run_)].count;
  }
  void next_run() {
    ++run_;
    for (std::optional<Stepper>& stepper : steppers_) stepper.reset();
  }

  Stepper& by(IntervalRule rule) {
    std::optional<Stepper>& stepper = steppers_[std::size_t(rule)];
    if (!stepper) stepper.emplace(problems_.by(rule).reduced().runs[std::size_t(run_)].step);
    return *stepper;
  }
  bool solve(IntervalRule rule, Index k, const Vector& x, GalerkinSolution& s) {
    return by(rule).solve(problems_.by(rule).reduced(), k, x, s.lcp);
  }

  // The first of the three rules that its own solution allows.
  std::optional<IntervalRule> take(Index k, const Vector& x, GalerkinSolution& s) {
    const bool smooth = solve(IntervalRule::galerkin, k, x, s);
    const IntervalRule needed = smooth ? choice_.needed(by(IntervalRule::galerkin).z) : IntervalRule::radau;
    if (needed == IntervalRule::galerkin) return needed;
    const bool by_radau = needed == IntervalRule::radau && !choice_.source_jumps(p_.t[k], p_.t[k + 1]) &&
                          solve(IntervalRule::radau, k, x, s);
    if (by_radau) {
      const Stepper& radau = by(IntervalRule::radau);
      if (!lets_go(radau.z) && choice_.needed(radau.z) != IntervalRule::euler) return IntervalRule::radau;
    }
    if (solve(IntervalRule::euler, k, x, s)) return IntervalRule::euler;
    if (by_radau) return IntervalRule::radau;
    return std::nullopt;
  }

  bool asked_to_stop(Index k, GalerkinSolution& s) const {
    if (options_.progress) options_.progress({k, 0, p_.N});
    if (!options_.interrupted || !options_.interrupted()) return false;
    MarchReport report;
    report.interrupted = true;
    stop_at(k, report, s);
    return true;
  }

  GalerkinSolution unsolved(Index k, GalerkinSolution& s) {
    MarchReport report;
    report.finite = s.x.row(k).allFinite();
    if (by(IntervalRule::euler).infeasible) report.infeasible = k + 1;
    ++s.lcp.unsolved;
    stop_at(k, report, s);
    return std::move(s);
  }

  void stop_at(Index k, MarchReport& report, GalerkinSolution& s) const {
    report.stopped = k + 1;
    explain_stop(p_, 0, report, s);
  }

  const ReducedProblems& problems_;
  RuleChoice& choice_;
  const Options& options_;
  const GalerkinProblem& p_;
  Index run_ = -1;
  std::optional<Stepper> steppers_[3];
};

}  // namespace

GalerkinSolution march_by_rules(const ReducedProblems& problems, RuleChoice& choice, const Options& options,
                                std::vector<IntervalRule>& rules) {
  return RuledMarch(problems, choice, options).run(rules);
}

}  // namespace bromwich
