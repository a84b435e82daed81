#pragma once
// Shared by the marches: the complementarity problem of one step, handling of unsolvable steps, polling.

#include "../base/timer.hpp"
#include "../lcp/active_set.hpp"
#include "../lcp/banded_lcp.hpp"
#include "../lcp/march_report.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <utility>

namespace bromwich::host {

// Counts the outcome of step j. Returns false if no solution could be certified; the report says why. `feasible`: the
// scene is known to have a solution.
inline bool count_step(const LcpOutcome& outcome, const Vector& q, bool feasible, Index j, MarchReport& report) {
  report.count.newton += outcome.newton;
  report.count.fallbacks += outcome.fallback;
  if (outcome.solved) {
    ++report.count.solved;
    return true;
  }
  ++report.count.unsolved;
  if (!q.allFinite())
    report.finite = false;
  else if (outcome.infeasible && !feasible)
    report.infeasible = j;
  report.stopped = j;
  return false;
}

// The LCP of a step and its counters. M + W_0 does not inherit the class of M, so its class is tested. If it is P with
// decaying entries, a banded solver is used; the dense solver is made when bands fail.
class StepLcp {
 public:
  // `without_dynamics`: the matrix of a step of length 0, where that is not M.
  StepLcp(const Matrix& implicit, const Matrix& M, LcpClass lcp_class, const Matrix& without_dynamics = {})
      : M_(M),
        implicit_(implicit),
        without_dynamics_(without_dynamics),
        scene_class_(lcp_class),
        implicit_class_(classify(LcpMatrix(implicit))),
        y_(Vector::Zero(implicit.rows())) {
    if (has_one_solution(implicit_class_) && !selects_least(lcp_class)) banded_ = simd::BandedLcp::make(implicit);
  }

  /// The problem determines its solution: the unique one, the one of least norm, or the least element.
  bool well_posed() const { return selects_least(scene_class_) || has_convex_solutions(implicit_class_); }

  void start_from(const Vector& y) {
    y_ = y;
    if (banded_)
      banded_->start_from(y);
    else
      dense().start_from(y);
  }

  // Returns false if no solution could be certified; the report says why.
  bool solve(const Vector& q, Vector& y, Index j, MarchReport& report) {
    const bool first = solved_ < all_timed;
    const bool timed = first || solved_ % timed_every == 0;
    ++solved_;
    const double before = timed ? timer_.lap() : 0;
    const LcpOutcome outcome = solve(q, y);
    if (timed) {
      const double own = timer_.lap();
      report.lcp_seconds += first ? own : std::min(double(timed_every) * own, before + own);
    }
    return count_step(outcome, q, has_one_solution(scene_class_), j, report);
  }

  /// (M + W_0) y of the last solution, n entries; null if it was not computed.
  const double* product() const { return product_; }

  std::size_t bytes() const {
    const Index matrices = banded_ && !solver_ ? 1 : 4;  // the dense solver is made when bands first fail
    return sizeof(double) * std::size_t(M_.size() + without_dynamics_.size() + matrices * implicit_.size()) +
           (banded_ ? banded_->bytes() : 0);
  }

 private:
  LcpOutcome solve(const Vector& q, Vector& y) {
    int newton = 0;
    product_ = nullptr;
    if (banded_ && banded_->solve(q, y, newton)) {
      product_ = banded_->product();
      return {.solved = true, .newton = newton};
    }
    if (banded_ && ++given_up_ > most_given_up) banded_.reset();
    LcpOutcome outcome = dense().solve(q, y);
    outcome.newton += newton;
    outcome.fallback |= newton > 0;
    if (banded_ && outcome.solved) banded_->start_from(y);
    if (outcome.infeasible && !selects_least(scene_class_)) outcome.infeasible = proof_is_not_of_rounding(q);
    return outcome;
  }

  // A proof holds up to rounding of M. W_0 of a very short step is below that, although it decides where M y = 0 for a
  // y > 0: that y may be an impulse. So the proof has to hold with a W_0 of the size of M, too.
  bool proof_is_not_of_rounding(const Vector& q) const {
    constexpr double drowned = 1e-6;
    const Matrix& M = without_dynamics_.size() > 0 ? without_dynamics_ : M_;
    const Matrix dynamics = implicit_ - M;
    const double size = dynamics.cwiseAbs().maxCoeff(), of_M = M.cwiseAbs().maxCoeff();
    if (!(size > 0 && size < drowned * of_M)) return true;
    const Matrix larger = M + of_M / size * dynamics;
    Vector y = Vector::Zero(q.size());
    return ActiveSetLcp(larger, classify(LcpMatrix(larger))).solve(q, y).infeasible;
  }

  ActiveSetLcp& dense() {
    if (!solver_) {
      solver_.emplace(implicit_, implicit_class_, selects_least(scene_class_) ? &M_ : nullptr);
      solver_->start_from(y_);
    }
    return *solver_;
  }

  static constexpr int most_given_up = 8;  ///< failures of the banded solver before it is abandoned
  // To read the clock takes as long as a small problem. Later ones stand for as many, up to the time since the last.
  static constexpr Index all_timed = 64, timed_every = 8;

  Matrix M_, implicit_, without_dynamics_;
  LcpClass scene_class_, implicit_class_;
  std::unique_ptr<simd::BandedLcp> banded_;
  std::optional<ActiveSetLcp> solver_;
  const double* product_ = nullptr;
  Vector y_;
  int given_up_ = 0;
  Index solved_ = 0;
  Timer timer_;
};

inline void invalidate(RowMatrix& y, RowMatrix& v, Index from) {
  y.bottomRows(y.rows() - from).setConstant(NAN);
  v.bottomRows(v.rows() - from).setConstant(NAN);
}

// Every `polled_every` steps: reports progress and polls for interruption.
class Poll {
 public:
  Poll(std::function<bool()> interrupted, std::function<void(Index)> progress)
      : interrupted_(std::move(interrupted)), progress_(std::move(progress)) {}
  template <class Problem>
  explicit Poll(const Problem& problem) : Poll(problem.interrupted, problem.progress) {}

  bool operator()(Index j, MarchReport& report) const {
    if (j % polled_every != 0) return false;
    if (progress_) progress_(j);
    if (!interrupted_ || !interrupted_()) return false;
    report.interrupted = true;
    report.stopped = j;
    return true;
  }

 private:
  static constexpr Index polled_every = 64;
  std::function<bool()> interrupted_;
  std::function<void(Index)> progress_;
};

}  // namespace bromwich::host
