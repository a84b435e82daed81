#include "core/march/marching.hpp"

#include "core/base/timer.hpp"
#include "core/march/outcome.hpp"

#include <cmath>

namespace bromwich {

namespace {

// The arrays that a march points to, and its run.
class Marching {
 public:
  Marching(const DiscreteProblem& p, const Options& options) : p_(p), wants_trace_(options.trace) {
    problem.M = &p.scene.M;
    problem.lcp_class = p.lcp_class;
    problem.interrupted = options.interrupted;
    if (options.progress) problem.progress = [&options, J = p.J](Index step) { options.progress({step, 0, J}); };
  }

  Array* array(const SampledSource& values) {
    Array* const made = array(values.rows(), values.cols());
    upload(p_.backend, values, *made);
    return made;
  }
  Array* array(const RowMatrix& values) {
    Array* const made = array(values.rows(), values.cols());
    p_.backend.upload(values, *made);
    return made;
  }

  void run(Timer& timer, bool impulse_allowed, Result& result) {
    const Index rows = p_.J + 1, n = p_.scene.constraints();
    const auto y = p_.backend.array(rows, n), v = p_.backend.array(rows, n);
    const auto march = p_.backend.march(problem, rows);
    result.bytes = 2 * y->bytes() + bytes_ + march->bytes() + host_bytes(p_);
    result.seconds.setup += timer.lap();

    const Start start = solve_at_zero(p_, result);
    if (start == Start::none) return;
    if (start == Start::impulse) {
      if (!impulse_allowed) {
        result.status = Status::unsupported;
        result.reason = "x0 violates the constraints and y has to jump; use method march or auto";
        return;
      }
      result.y.row(0).setZero();  // implicit Euler does not look at it
      result.kernel += impulse_note;
    }
    p_.backend.upload(result.y, *y);
    result.seconds.lcp += timer.lap();
    const MarchReport report = march->run(*y, *v);
    p_.backend.download(*y, result.y);
    if (start == Start::impulse) result.y.row(0) = result.y.row(1);
    count(report, result);
    if (wants_trace_) result.trace = trace(p_, *problem.r, *v);
    result.well_posed = report.well_posed;
    if (report.stopped >= 0) return explain_stop(p_, report, result);
    result.residual = march_residual(p_, start, *problem.r, *v, *y);
    result.status = Status::solved;
  }

  MarchProblem problem;

 private:
  Array* array(Index rows, Index cols) {
    arrays_.push_back(p_.backend.array(rows, cols));
    bytes_ += arrays_.back()->bytes();
    return arrays_.back().get();
  }

  const DiscreteProblem& p_;
  bool wants_trace_;
  std::vector<std::unique_ptr<Array>> arrays_;
  std::size_t bytes_ = 0;
};

}  // namespace

void solve_by_marching(TimeOperator& op, Rule rule, const Options& options, Result& result) {
  Timer timer;
  const DiscreteProblem& p = op.problem();
  const MarchData data = op.march_data(rule, options.recurrence);
  result.kernel = data.description;
  result.kernel_error = data.error;
  Marching marching(p, options);
  marching.problem.recurrence = recurrence_of(*data.weights);
  marching.problem.lags = lag_table_of(*data.weights);
  Array* const r = marching.array(data.r);
  p.backend.upload(p.start.transpose(), *r);  // row 0
  add_rough_response(p, *r);
  marching.problem.r = r;
  if (data.drive) marching.problem.drive = marching.array(*data.drive);
  if (data.forcing.size() > 0) {
    marching.problem.forcing = marching.array(data.forcing);
    marching.problem.sources = &p.f.table();
    marching.problem.source_input = &data.source_input;
  }
  if (data.start.size() > 0) marching.problem.start = &data.start;
  marching.run(timer, rule == Rule::implicit_euler, result);
  result.bytes += data.bytes();
}

}  // namespace bromwich
