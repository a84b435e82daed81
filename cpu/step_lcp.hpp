#pragma once
// What the marches share: the complementarity problem of one step, rows without a solution, polling.

#include "core/lcp/active_set_lcp.hpp"
#include "cpu/parts.hpp"

#include <chrono>
#include <cmath>

namespace bromwich::cpu {

// The LCP of a step and its bookkeeping. M + W_0 does not inherit the class of M: it is tested itself.
class StepLcp {
 public:
  StepLcp(const Matrix& implicit, const Matrix& M, LcpClass lcp_class)
      : M_(M),
        scene_class_(lcp_class),
        implicit_class_(classify(LcpMatrix(implicit))),
        solver_(implicit, implicit_class_, lcp_class == LcpClass::Z ? &M_ : nullptr) {}

  /// The problem of a step determines its solution: it is the only one, of least norm, or a least element.
  bool well_posed() const {
    return scene_class_ == LcpClass::Z || implicit_class_ == LcpClass::P || implicit_class_ == LcpClass::PSD;
  }

  void start_from(const Vector& y) { solver_.start_from(y); }

  // false: no solution could be certified; the report says why.
  bool solve(const Vector& q, Vector& y, Index j, MarchReport& report) {
    const auto start = std::chrono::steady_clock::now();
    const LcpOutcome outcome = solver_.solve(q, y);
    report.lcp_seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    report.count.newton += outcome.newton;
    report.count.fallbacks += outcome.fallback;
    if (outcome.solved) {
      ++report.count.solved;
      return true;
    }
    ++report.count.unsolved;
    if (!q.allFinite())
      report.finite = false;
    else if (outcome.infeasible && scene_class_ != LcpClass::P)  // with M of class P the scene has a solution
      report.infeasible = j;
    report.stopped = j;
    return false;
  }

 private:
  Matrix M_;
  LcpClass scene_class_, implicit_class_;
  ActiveSetLcp solver_;
};

inline void invalidate(RowMatrix& y, RowMatrix& v, Index from) {
  y.bottomRows(y.rows() - from).setConstant(NAN);
  v.bottomRows(v.rows() - from).setConstant(NAN);
}

// Every `polled_every` steps: reports progress and looks whether to stop.
class Poll {
 public:
  template <class Problem>
  explicit Poll(const Problem& problem) : interrupted_(problem.interrupted), progress_(problem.progress) {}

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

}  // namespace bromwich::cpu
