#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/galerkin/recurrence.hpp"
#include "core/galerkin/solvers.hpp"
#include "core/lcp/lcp_class.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

void explain_stop(const GalerkinProblem& p, Index first, const MarchReport& report, GalerkinSolution& s) {
  const Index at = first + report.stopped - 1;
  const std::string where = text("in the interval that begins at t = %.6g", p.t[at]);
  s.status = Status::tolerance_not_met;
  if (report.interrupted) {
    s.status = Status::interrupted;
    s.reason = why_interrupted() + " " + where;
  } else if (!report.finite) {
    s.status = Status::nonfinite;
    s.reason = "the solution is not finite " + where;
  } else if (report.infeasible >= 0) {
    s.status = Status::infeasible;
    s.infeasible = first + report.infeasible - 1;
    s.reason = "no solution " + where;
  } else {
    s.reason = "the complementarity problem stayed unsolved " + where + "; try other steps";
  }
}

namespace {

// The intervals of one length, from the state x; their rows of z, and x behind them.
void march_run(const GalerkinProblem& p, const GalerkinRun& run, Backend& backend, const Options& options, Vector& x,
               GalerkinSolution& s) {
  const LcpMatrix D = run.step.D;
  const Recurrence recurrence = galerkin_recurrence(run.step);
  const RowMatrix own_q = p.q.middleRows(run.first, run.count),
                  own_forcing = p.forcing.middleRows(run.first, run.count);
  const auto q = padded_array(own_q, backend), forcing = padded_array(own_forcing, backend);
  MarchProblem problem;
  problem.M = &D;
  problem.lcp_class = classify(D);
  problem.recurrence = &recurrence;
  problem.r = q.get();
  problem.start = &x;
  problem.forcing = forcing.get();
  problem.interrupted = options.interrupted;
  if (options.progress) problem.progress = [&](Index step) { options.progress({run.first + step, 0, p.N}); };
  const auto y = backend.array(run.count + 1, p.unknowns()), v = backend.array(run.count + 1, p.unknowns());
  const auto march = backend.march(problem, run.count + 1);
  const MarchReport report = march->run(*y, *v);
  RowMatrix z;
  backend.download(*y, z);
  s.z.middleRows(run.first, run.count) = z.bottomRows(run.count);
  s.unique = s.unique && has_one_solution(problem.lcp_class);
  s.lcp += report.count;
  s.lcp_seconds += report.lcp_seconds;
  s.bytes = std::max(s.bytes, q->bytes() + forcing->bytes() + y->bytes() + v->bytes() + march->bytes());
  s.status = Status::solved;
  if (report.stopped >= 0) explain_stop(p, run.first, report, s);
  const bool last = run.first + run.count == p.N;
  for (Index k = 0; !last && k < run.count; ++k)
    x = (run.step.E * x + run.step.H * z.row(k + 1).transpose() + own_forcing.row(k).transpose()).eval();
}

}  // namespace

GalerkinSolution march_galerkin(const GalerkinProblem& p, Backend& backend, const Options& options) {
  GalerkinSolution s;
  s.how = "interval by interval";
  s.iterations = 1;
  s.unique = true;
  s.z = RowMatrix::Constant(p.N, p.unknowns(), NAN);
  Vector x = p.boundary.b;
  for (const GalerkinRun& run : p.runs) {
    march_run(p, run, backend, options, x, s);
    if (s.status != Status::solved) break;
  }
  s.x = galerkin_states(p, s.z);
  return s;
}

}  // namespace bromwich
