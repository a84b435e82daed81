#include "core/marching.hpp"

#include "core/compression.hpp"
#include "core/lcp.hpp"
#include "core/timer.hpp"

#include <cmath>
#include <cstdio>

namespace bromwich {

namespace {

constexpr double compression_tolerance = 1e-13;
constexpr double accepted_compression_error = 1e-11;

struct Plan {
  Recurrence recurrence;
  RowMatrix r;  ///< what the recurrence leaves out
  double error = 0;
};

Plan modal_plan(const DiscreteProblem& p, Rule rule) {
  const KroneckerDynamics& d = *p.kronecker();
  return {modal_recurrence(d, rule, p.h, x0_in_modes(p.backend, d, p.scene.x0, true)), p.g};
}

Plan compressed_plan(const DiscreteProblem& p, const ExponentialSum& sum) {
  const KroneckerDynamics& d = *p.kronecker();
  const Index rows = p.J + 1, n = d.along.points;
  const auto modes = p.backend.array(rows, n), r = p.backend.array(rows, n);
  p.backend.upload(kronecker_initial_response(p), *modes);
  p.backend.upload(p.g, *r);
  p.backend.sine_transform(n, rows)->apply(*modes, r.get(), *r, 0);
  Plan plan{compressed_recurrence(p.backend, d, sum, p.h), {}, sum.error};
  p.backend.download(*r, plan.r);
  return plan;
}

Plan make_plan(const DiscreteProblem& p, Rule rule, RecurrenceChoice choice, std::string& description) {
  if (const DenseDynamics* d = p.dense()) {
    description = "state of the scene, stepped";
    return {dense_recurrence(*d, rule, p.h), dense_response(p, rule)};
  }
  const Index all = p.kronecker()->across.points;
  if (rule == Rule::exponential && choice != RecurrenceChoice::modal) {
    const ExponentialSum sum = compress_line_kernel(*p.kronecker(), p.h, p.scene.T, compression_tolerance);
    const bool pays = 2 * sum.rates.size() <= all && sum.error <= accepted_compression_error;
    if (choice == RecurrenceChoice::compressed || pays) {
      description = std::to_string(sum.rates.size()) + " exponentials a mode, stepped";
      return compressed_plan(p, sum);
    }
  }
  description = std::to_string(all) + " eigenvalues a mode, stepped";
  return modal_plan(p, rule);
}

}  // namespace

void solve_by_marching(const DiscreteProblem& p, Rule rule, const Options& options, Result& result) {
  Timer timer;
  const Index rows = p.J + 1, n = p.scene.constraints();
  Plan plan = make_plan(p, rule, options.recurrence, result.kernel);
  result.kernel_error = plan.error;
  plan.r.row(0) = p.start.transpose();
  const auto y = p.backend.array(rows, n), v = p.backend.array(rows, n), r = p.backend.array(rows, n);
  p.backend.upload(plan.r, *r);
  std::unique_ptr<Array> drive;
  if (p.kronecker() && p.drive()) {
    drive = p.backend.array(rows, n);
    p.backend.upload(*p.drive(), *drive);
  }
  const auto march =
      p.backend.march({&p.scene.M, p.lcp_class, &plan.recurrence, r.get(), drive.get(), options.interrupted}, rows);
  const auto lcp = p.backend.lcp(p.scene.M, p.lcp_class, rows);
  // y_0 in SOL(M, N x0 + g(0)): one problem, as a batch of one row.
  const auto first_r = p.backend.array(1, n), first_v = p.backend.array(1, n), first_y = p.backend.array(1, n);
  p.backend.upload(p.start.transpose(), *first_r);
  result.bytes = y->bytes() * 3 + (drive ? drive->bytes() : 0) + march->bytes() + lcp->bytes();
  result.seconds.setup += timer.lap();

  const LcpReport at_zero = p.backend.lcp(p.scene.M, p.lcp_class, 1)->solve(*first_r, *first_v, *first_y, 0, 0);
  result.y = RowMatrix::Constant(rows, n, NAN);
  if (at_zero.count.unsolved > 0 || !at_zero.finite) {
    result.status = at_zero.infeasible == 0 ? Status::infeasible : Status::tolerance_not_met;
    result.reason = at_zero.infeasible == 0 ? "no solution at t = 0" : "the problem at t = 0 stayed unsolved";
    if (at_zero.infeasible == 0) result.infeasible_at = 0;
    return;
  }
  RowMatrix start;
  p.backend.download(*first_y, start);
  result.y.row(0) = start;
  p.backend.upload(result.y, *y);
  result.seconds.lcp += timer.lap();

  const MarchReport report = march->run(*y, *v);
  p.backend.download(*y, result.y);
  result.iterations = 1;
  result.lcp = report.count;
  result.lcp.solved += 1;
  result.lcp.newton += at_zero.count.newton;
  result.seconds.lcp += report.lcp_seconds;
  if (report.stopped < 0) {
    result.residual = lcp->residual(*r, *v, *y);
    result.status = Status::solved;
    return;
  }
  result.residual = NAN;
  char where[64];
  std::snprintf(where, sizeof where, "t = %.6g", p.t[report.stopped]);
  if (report.interrupted) {
    result.status = Status::interrupted;
    result.reason = std::string("stopped on request at ") + where;
  } else if (!report.finite) {
    result.status = Status::nonfinite;
    result.reason = std::string("the solution is not finite at ") + where;
  } else if (report.infeasible >= 0) {
    result.status = Status::infeasible;
    result.infeasible_at = p.t[report.infeasible];
    result.reason = std::string("no solution from ") + where + " on";
  } else {
    result.status = Status::tolerance_not_met;
    result.reason = std::string("the complementarity problem of the step to ") + where +
                    " stayed unsolved; try other steps or method contour";
  }
}

}  // namespace bromwich
