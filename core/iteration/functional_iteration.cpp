#include "core/iteration/functional_iteration.hpp"

#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/iteration/sweep_forecast.hpp"
#include "core/kernel/compression.hpp"
#include "core/kernel/kernel.hpp"
#include "core/kernel/ringing.hpp"
#include "core/kernel/weight_check.hpp"
#include "core/lcp/active_set.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/march/outcome.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

/// An iterate may be infeasible temporarily (Theorem 3.2 bounds only short horizons). After this many sweeps in which
/// no further row settled, it is considered permanent.
constexpr Index most_infeasible_sweeps = 40;
/// Likewise problems that stay unsolved: all solvers are tried on them in every sweep. In small ones that costs little,
/// and iterates may come back from it; in large ones n^3 operations a problem are a few seconds together.
constexpr double most_unsolved_work = 1e10;

// Monitors the sweeps and decides when to stop.
class Watch {
 public:
  explicit Watch(double tolerance) : tolerance_(tolerance) {}

  // Sweeps in which nothing settled and changes did not fall.
  Index stuck() const { return stuck_; }

  // The outcome if it is known. `advanced`: rows have settled since the last sweep.
  std::optional<IterationOutcome> after(const DiscreteProblem& p, const LcpReport& report, bool advanced) {
    if (!report.finite || !(report.magnitude < 1e100))
      return IterationOutcome{Status::nonfinite, "the iterates grew beyond all bounds", -1};
    infeasible_for_ = report.infeasible >= 0 && !advanced ? infeasible_for_ + 1 : 0;
    // Rounding keeps the changes of a converged iteration at a low level; in a 2-cycle they may have any size.
    stuck_ = advanced || report.change < 0.99 * best_ ? 0 : stuck_ + 1;
    best_ = std::min(best_, report.change);
    if (report.change <= tolerance_ || (stuck_ >= 12 && report.change <= rounding_level)) return converged(report);
    if (infeasible_for_ >= most_infeasible_sweeps)
      return IterationOutcome{Status::tolerance_not_met,
                              text("the iterate is infeasible from t = %.6g on", p.t[report.infeasible]),
                              report.infeasible};
    unsolved_for_ = report.count.unsolved > 0 && !advanced ? unsolved_for_ + 1 : 0;
    unsolved_work_ += double(report.count.unsolved) * std::pow(double(p.scene.constraints()), 3);
    if (unsolved_for_ >= most_infeasible_sweeps || (unsolved_work_ > most_unsolved_work && unsolved_for_ > 1))
      return IterationOutcome{
          Status::tolerance_not_met,
          text("%ld complementarity problems stay unsolved, sweep for sweep; use method march", report.count.unsolved),
          -1};
    if (stuck_ >= 200)
      return IterationOutcome{
          Status::tolerance_not_met,
          text("the iteration does not contract: change %.2e in the last sweep; use method march", report.change), -1};
    return std::nullopt;
  }

 private:
  static constexpr double rounding_level = 1e-10;

  static IterationOutcome converged(const LcpReport& report) {
    if (report.count.unsolved == 0) return {Status::solved, "", -1};
    return {Status::tolerance_not_met, text("%ld complementarity problems stayed unsolved", report.count.unsolved),
            report.infeasible};
  }

  double tolerance_, best_ = INFINITY, unsolved_work_ = 0;
  Index stuck_ = 0, infeasible_for_ = 0, unsolved_for_ = 0;
};

void count(const LcpReport& report, double seconds, Result& result) {
  result.seconds.lcp += seconds;
  result.lcp.solved += report.count.solved;
  result.lcp.newton += report.count.newton;
  result.lcp.fallbacks += report.count.fallbacks;
  result.lcp.unsolved = report.count.unsolved;
  ++result.iterations;
}

// Solves on other grids (half the step, windows in time) have the same options but start from x0.
void start_from_given(const DiscreteProblem& p, const Options& options, Array& y) {
  const RowMatrix* given = options.tuning.first_iterate;
  if (!given || given->rows() != p.J + 1 || selects_least(p.lcp_class)) return;
  RowMatrix start;
  p.backend.download(y, start);
  start.bottomRows(p.J) = given->bottomRows(p.J);  // y_0 already solves its problem
  p.backend.upload(start, y);
}

// Predicts from the observed sweeps whether an iteration will converge.
class Outlook {
 public:
  Outlook(const DiscreteProblem& p, const Options& options)
      : p_(p), forecast_(p.J, options.iteration_tolerance, options.max_iterations) {}

  std::optional<IterationOutcome> after(const LcpReport& report, Index stuck, const Array& y) {
    forecast_.add(report.settled, report.change);
    if (const auto why = forecast_.hopeless()) return IterationOutcome{Status::tolerance_not_met, *why, -1};
    if (stuck < stuck_for_some_time) {
      at_ = y.rows();
      last_.resize(0, 0);
      return std::nullopt;
    }
    RowMatrix values;
    p_.backend.download(y, values);
    at_ = std::min(at_, first_moving(values));  // in a cycle a row may rest in some sweeps
    last_ = values;
    if (at_ >= y.rows()) return std::nullopt;
    const auto contracts = front_.contracts(at_, values.row(at_).transpose());
    if (!contracts || *contracts) return std::nullopt;
    return IterationOutcome{Status::tolerance_not_met,
                            text("the sweeps do not contract at t = %.6g, where a change comes back %.2g times as "
                                 "large: M does not outweigh the first lag there; use method march or more steps",
                                 p_.t[at_], front_.factor()),
                            -1};
  }

 private:
  static constexpr Index stuck_for_some_time = 24;

  // The first row that the last sweep changed by more than rounding: earlier rows may never settle to the last digit.
  Index first_moving(const RowMatrix& y) const {
    constexpr double rounding = 1e-10;
    Index j = 0;
    while (j < last_.rows() &&
           (y.row(j) - last_.row(j)).cwiseAbs().maxCoeff() <= rounding * std::max(1.0, y.row(j).cwiseAbs().maxCoeff()))
      ++j;
    return last_.rows() > 0 ? j : y.rows();
  }

  const DiscreteProblem& p_;
  SweepForecast forecast_;
  FrontRow front_;
  Index at_ = 0;  ///< the row at the front
  RowMatrix last_;
};

// The first iterate: x^0(t) = x0 (Theorem 3.2), q_j = N x0 + g_j, or `start`. Returns an outcome if the iteration ends
// here.
std::optional<IterationOutcome> first_iterate(const DiscreteProblem& p, const Options& options, LcpBatch& lcp,
                                              const Array* start, Array& y, Array& v, Result& result) {
  Timer timer;
  std::unique_ptr<Array> q;
  if (!start) {
    q = p.backend.array(p.J + 1, p.scene.constraints());
    upload(p.backend, p.g.plus(p.start - p.g.row(0)), *q);
  }
  timer.lap();
  const LcpReport report = lcp.solve(start ? *start : *q, v, y, 0);
  count(report, timer.lap(), result);
  // q_0 does not change any more.
  if (report.infeasible == 0 && may_have_impulse(p))
    return IterationOutcome{Status::unsupported,
                            text("at t = %.6g the state violates the constraints and has to jump; use method march or "
                                 "auto",
                                 p.t[0]),
                            -1};
  if (report.infeasible == 0) return IterationOutcome{Status::infeasible, "no solution at t = 0", 0, 0};
  start_from_given(p, options, y);
  return std::nullopt;
}

}  // namespace

IterationOutcome iterate(const DiscreteProblem& p, const Options& options, const ApplyKernel& apply, bool recordable,
                         LcpBatch& lcp, const Array& r, Array& y, Array& v, Result& result, const Array* start) {
  const double settle = std::max(0.01 * options.iteration_tolerance, 32 * epsilon);
  if (auto outcome = first_iterate(p, options, lcp, start, y, v, result)) return *outcome;
  Timer timer, sweeps;
  // Short sweeps are recorded once; they then do all rows, since leaving out what has settled would save nothing.
  std::function<void()> sweep;
  if (recordable && lcp.recorded)
    sweep = p.backend.record(y.rows() * y.cols(), [&] {
      apply(y, v, 0);
      lcp.submit(r, v, y, 0, settle);
    });
  Watch watch(options.iteration_tolerance);
  Outlook outlook(p, options);
  Index first = 0;        // rows before it have settled
  Index solved_from = 0;  // rows before it were not in the last batch
  Index furthest = 0;     // largest value of `first`, which may decrease in recorded sweeps
  const auto ended = [&](IterationOutcome outcome) {
    outcome.settled = first;
    result.seconds.sweeps = sweeps.lap();
    return outcome;
  };
  while (result.iterations < options.max_iterations) {
    if (options.interrupted && options.interrupted()) return ended({Status::interrupted, why_interrupted(), -1});
    LcpReport report;
    if (sweep) {
      sweep();
      timer.lap();
      report = lcp.finish(r, v, y, 0, settle);
    } else {
      apply(y, v, solved_from);
      timer.lap();
      report = lcp.solve(r, v, y, first, settle);
    }
    count(report, timer.lap(), result);
    result.history.push_back(report.change);
    if (options.progress) options.progress({result.iterations, report.change});
    const bool advanced = report.settled > furthest;
    furthest = std::max(furthest, report.settled);
    solved_from = first;
    first = report.settled;
    if (auto outcome = watch.after(p, report, advanced)) return ended(*outcome);
    if (auto outcome = outlook.after(report, watch.stuck(), y)) return ended(*outcome);
  }
  const double last = result.history.empty() ? NAN : result.history.back();
  return ended({Status::tolerance_not_met,
                text("change %.2e after %ld iterations, the limit", last, long(result.iterations)), -1});
}

void finish_iteration(const DiscreteProblem& p, const Options& options, const IterationOutcome& outcome,
                      const ApplyKernel& apply, LcpBatch& lcp, const Array& r, const Array& y, Array& v,
                      Result& result) {
  result.status = outcome.status;
  result.reason = outcome.reason;
  result.well_posed = selects_one(p.lcp_class);
  if (outcome.infeasible >= 0) result.infeasible_at = p.t[outcome.infeasible];
  p.backend.download_during(y, result.y, [&] {
    if (outcome.status == Status::infeasible || outcome.status == Status::unsupported) return;
    result.alternates = p.backend.alternates(y, ringing_run, ringing_part);
    apply(y, v, 0);
    result.residual = lcp.residual(r, v, y);
  });
  if (outcome.status == Status::infeasible || outcome.status == Status::unsupported) return;
  if (options.trace) result.trace = trace(p, r, v);
  // Rows that had not settled when the iteration was stopped are not a solution.
  if (outcome.status == Status::interrupted || outcome.status == Status::nonfinite)
    result.y.bottomRows(result.y.rows() - outcome.settled).setConstant(NAN);
}

namespace {

class PreparedIteration final : public PreparedMethod {
 public:
  PreparedIteration(TimeOperator& op, const Options& options)
      : op_(op), p_(op.problem()), plan_(op.kernel(options.tuning.convolution)) {
    const Index rows = p_.J + 1, n = p_.scene.constraints();
    for (auto* array : {&y_, &v_, &r_}) *array = p_.backend.array(rows, n);
    lcp_ = p_.backend.lcp(p_.scene.M, p_.lcp_class, rows);
    respond();
    if (!selects_one(p_.lcp_class)) at_zero_.emplace(p_);
  }

  void renew(const Changes& changes) override {
    if (changes.any()) respond();
    if (changes.any() && at_zero_) at_zero_->renew();
  }

  void run(const Options& options, Result& result) override {
    result.kernel = plan_.description;
    result.kernel_error = std::isnan(plan_.error) ? NAN : std::max(plan_.error, error_of_x0_);
    Vector y0;
    if (at_zero_ && at_zero_->solve(result, y0) == Start::none) return;  // no sweep changes this problem
    // It starts with v = 0 and y = 0, like new arrays.
    for (Array* array : {v_.get(), y_.get()})
      if (used_) p_.backend.add(*r_, -1, *r_, *array);
    used_ = true;
    SpaceTimeKernel& kernel = *plan_.kernel;
    result.bytes += y_->bytes() + v_->bytes() + r_->bytes() + kernel.bytes() + lcp_->bytes() + host_bytes(p_) +
                    op_.bytes_of_tables();
    kernel.transform_seconds = kernel.convolution_seconds = 0;
    const ApplyKernel apply = [&](const Array& in, Array& out, Index first) { kernel.apply(in, out, first); };
    const IterationOutcome outcome = iterate(p_, options, apply, kernel.recorded(), *lcp_, *r_, *y_, *v_, result);
    finish_iteration(p_, options, outcome, apply, *lcp_, *r_, *y_, *v_, result);
    result.seconds.transform = kernel.transform_seconds;
    result.seconds.convolution = kernel.convolution_seconds;
  }

 private:
  void respond() { error_of_x0_ = op_.response(plan_, *p_.backend.array(r_->rows(), r_->cols()), *r_); }

  TimeOperator& op_;
  const DiscreteProblem& p_;
  KernelPlan plan_;
  double error_of_x0_ = 0;
  bool used_ = false;  ///< the arrays contain a previous run
  std::unique_ptr<Array> y_, v_, r_;
  std::unique_ptr<LcpBatch> lcp_;
  std::optional<ProblemAtZero> at_zero_;  ///< where M does not say that it has a solution
};

}  // namespace

std::unique_ptr<PreparedMethod> prepare_iteration(TimeOperator& op, const Options& options) {
  return std::make_unique<PreparedIteration>(op, options);
}

}  // namespace bromwich
