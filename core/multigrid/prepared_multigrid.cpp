#include "core/base/first_touch.hpp"
#include "core/base/timer.hpp"
#include "core/march/outcome.hpp"
#include "core/multigrid/multigrid.hpp"

#include <utility>

namespace bromwich {

namespace {

void add_seconds(TimeLevels& levels, Result& result) {
  for (auto& level : levels.grids) {
    result.seconds.transform += level->kernel->transform_seconds;
    result.seconds.convolution += level->kernel->convolution_seconds;
  }
}

class PreparedMultigrid final : public PreparedMethod {
 public:
  PreparedMultigrid(TimeOperator& op, const Options& options, TimeLevels levels)
      : op_(op), p_(op.problem()), levels_(std::move(levels)), multigrid_(p_.backend, options, levels_), at_zero_(p_) {}

  void renew(const Changes& changes) override {
    at_zero_.renew();  // first: it waits for a device
    levels_.kernel_error = levels_.take_sources(changes);
  }

  void run(const Options& options, Result& result) override {
    Timer timer;
    result.kernel = levels_.description;
    result.kernel_error = levels_.kernel_error;
    result.bytes += host_bytes(p_) + op_.bytes_of_tables();
    for (auto& level : levels_.grids) {
      result.bytes += level->bytes();
      level->kernel->transform_seconds = level->kernel->convolution_seconds = 0;
    }
    multigrid_.begin(options, result);
    Vector y0;
    if (at_zero_.solve(result, y0) != Start::found) return;
    const IterationOutcome outcome = cycles(y0, result, timer);
    multigrid_.report_work();
    TimeLevel& finest = levels_[0];
    const ApplyKernel apply = [&](const Array& in, Array& out, Index first) { finest.kernel->apply(in, out, first); };
    const auto lcp =
        finest.lcp ? nullptr : p_.backend.lcp(p_.scene.M, p_.lcp_class, p_.J + 1);  // null: the grid is marched
    finish_iteration(p_, options, outcome, apply, finest.lcp ? *finest.lcp : *lcp, *finest.r, *finest.y, *finest.v,
                     result);
    if (result.status == Status::solved) result.error_estimate = multigrid_.discretisation_error();
    add_seconds(levels_, result);
  }

 private:
  // The host gets the memory of the result while a device works. That may take longer than the sweeps, and is no part
  // of their time.
  IterationOutcome cycles(const Vector& y0, Result& result, Timer& timer) {
    const bool works_beside = levels_[0].lcp && !levels_[0].lcp->at_once;
    std::optional<FirstTouch> touch;
    if (works_beside) {
      result.y.resize(p_.J + 1, p_.scene.constraints());
      touch.emplace(result.y.data(), std::size_t(result.y.size()));
    }
    multigrid_.nest(y0);
    const IterationOutcome outcome = multigrid_.iterate();
    result.seconds.sweeps = timer.lap();
    return outcome;
  }

  TimeOperator& op_;
  const DiscreteProblem& p_;
  TimeLevels levels_;
  Multigrid multigrid_;
  ProblemAtZero at_zero_;
};

}  // namespace

std::unique_ptr<PreparedMethod> prepare_multigrid(TimeOperator& op, const Options& options) {
  TimeLevels levels = time_levels(op, options);
  if (levels.size() == 0) return nullptr;
  return std::make_unique<PreparedMultigrid>(op, options, std::move(levels));
}

}  // namespace bromwich
