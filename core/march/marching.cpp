#include "core/march/marching.hpp"

#include "core/base/timer.hpp"
#include "core/kernel/pole_plans.hpp"
#include "core/march/outcome.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

class PreparedMarch final : public PreparedMethod {
 public:
  PreparedMarch(TimeOperator& op, Rule rule, const Options& options)
      : op_(op), p_(op.problem()), rule_(rule), data_(op.march_weights(rule, options.tuning.recurrence)), at_zero_(p_) {
    const Index rows = p_.J + 1, n = p_.scene.constraints();
    for (auto* array : {&y_, &v_, &r_}) *array = p_.backend.array(rows, n);
    op_.add_sources(rule_, data_, {});
    if (data_.drive) drive_ = p_.backend.array(rows, n);
    if (data_.forcing.size() > 0) forcing_ = p_.backend.array(rows, data_.forcing.cols());
    MarchProblem problem;
    problem.M = &p_.scene.M;
    problem.lcp_class = p_.lcp_class;
    problem.interrupted = options.interrupted;
    if (options.progress)
      problem.progress = [progress = options.progress, J = p_.J](Index step) { progress({step, 0, J}); };
    problem.r = r_.get();
    problem.drive = drive_.get();
    if (forcing_) {
      problem.forcing = forcing_.get();
      problem.sources = &p_.f.table();
      problem.source_input = &data_.source_input;
    }
    if (data_.start.size() > 0) problem.start = &data_.start;
    upload_sources();
    upload_start();
    march_ = make_march(p_.backend, problem, *data_.weights, rows);
  }

  void renew(const Changes& changes) override {
    at_zero_.renew();
    const bool had_x0 = data_.r_has_x0;
    op_.add_sources(rule_, data_, changes);
    if (changes.sources || had_x0 || data_.r_has_x0) upload_sources();
    upload_start();
  }

  void run(const Options& options, Result& result) override {
    result.kernel = data_.description;
    result.kernel_error = std::max(data_.error, data_.error_of_x0);
    if (std::isnan(data_.error)) result.kernel_error = NAN;
    result.bytes = y_->bytes() + v_->bytes() + r_->bytes() + (drive_ ? drive_->bytes() : 0) +
                   (forcing_ ? forcing_->bytes() : 0) + march_->bytes() + host_bytes(p_) + data_.bytes();
    Timer timer;
    Vector y0;
    const Start start = at_zero_.solve(result, y0);
    if (start == Start::none) return;
    if (start == Start::impulse) {
      if (rule_ != Rule::implicit_euler) {
        result.status = Status::unsupported;
        result.reason = "x0 violates the constraints and y has to jump; use method march or auto";
        return;
      }
      y0 = Vector::Zero(p_.scene.constraints());  // implicit Euler does not use it
      result.kernel += impulse_note;
      result.starts_with_impulse = true;
    }
    p_.backend.upload(y0.transpose(), *y_);  // row 0: the march writes the others
    result.seconds.lcp += timer.lap();
    const MarchReport report = march_->run(*y_, *v_);
    p_.backend.download(*y_, result.y);
    if (report.stopped >= 0) result.y.bottomRows(p_.J + 1 - report.stopped).setConstant(NAN);
    count(report, result);
    if (options.trace) result.trace = trace(p_, *r_, *v_);
    if (start == Start::impulse) begin_behind_the_impulse(options.trace, result);
    result.well_posed = report.well_posed;
    if (report.stopped >= 0) return explain_stop(p_, report, result);
    result.residual = residual(start);
    result.status = Status::solved;
  }

 private:
  // Its plan stays where the method does.
  double residual(Start start) {
    if (start != Start::found || !op_.keeps_prepared()) return march_residual(p_, start, *r_, *v_, *y_);
    if (!lcp_) lcp_ = p_.backend.lcp(p_.scene.M, p_.lcp_class, p_.J + 1);
    return lcp_->residual(*r_, *v_, *y_);
  }
  // y and w of row 0 are those of row 1.
  void begin_behind_the_impulse(bool traced, Result& result) const {
    result.y.row(0) = result.y.row(1);
    if (traced) result.trace.row(0) = result.trace.row(1) + (p_.g.row(1) - p_.g.row(0)).transpose();
  }
  void upload_sources() {
    upload(p_.backend, data_.r, *r_);
    add_rough_response(p_, *r_);
    if (drive_) upload(p_.backend, *data_.drive, *drive_);
    if (forcing_) p_.backend.upload(data_.forcing, *forcing_);
  }
  void upload_start() { p_.backend.upload(p_.start.transpose(), *r_); }  // row 0

  TimeOperator& op_;
  const DiscreteProblem& p_;
  Rule rule_;
  MarchData data_;
  std::unique_ptr<Array> y_, v_, r_, drive_, forcing_;
  std::unique_ptr<March> march_;
  ProblemAtZero at_zero_;
  std::unique_ptr<LcpBatch> lcp_;
};

}  // namespace

std::unique_ptr<PreparedMethod> prepare_march(TimeOperator& op, Rule rule, const Options& options) {
  return std::make_unique<PreparedMarch>(op, rule, options);
}

}  // namespace bromwich
