#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/galerkin/recurrence.hpp"
#include "core/galerkin/solvers.hpp"
#include "core/lcp/active_set.hpp"
#include "core/lcp/lcp_class.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

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

// The states of a run, from that before it. The march has solved each interval for a state of its own, and a mode that
// grows makes of the rounding between the two whatever it likes, though y holds it: where z of an interval does not
// solve it for the state here, it is solved again.
void follow(const GalerkinProblem& p, const GalerkinRun& run, LcpClass lcp_class, GalerkinSolution& s) {
  constexpr double solved = 1e-11;  // of the terms: a march solves to 256 roundings
  const GalerkinStep& step = run.step;
  std::optional<ActiveSetLcp> lcp;
  for (Index k = run.first; k < run.first + run.count; ++k) {
    const Vector x = s.x.row(k).transpose(), known = p.q.row(k).transpose() + step.C * x;
    Vector z = s.z.row(k).transpose();
    const Vector answer = step.D * z, w = known + answer;
    const double terms = std::max(known.cwiseAbs().maxCoeff(), answer.cwiseAbs().maxCoeff());
    if (z.cwiseMin(w).cwiseAbs().maxCoeff() > solved * terms) {
      if (!lcp) lcp.emplace(step.D, lcp_class);
      Vector found;
      if (lcp->solve(known, found).solved) s.z.row(k) = (z = found).transpose();
    }
    s.x.row(k + 1) = (step.E * x + step.H * z + p.forcing.row(k).transpose()).transpose();
  }
}

// The intervals of one length: their rows of z, and the states behind them.
void march_run(const GalerkinProblem& p, const GalerkinRun& run, Backend& backend, const Options& options,
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
  const Vector start = s.x.row(run.first).transpose();
  problem.start = &start;
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
  follow(p, run, problem.lcp_class, s);
}

}  // namespace

GalerkinSolution march_galerkin(const GalerkinProblem& p, Backend& backend, const Options& options) {
  GalerkinSolution s;
  s.how = "interval by interval";
  s.iterations = 1;
  s.unique = true;
  s.z = RowMatrix::Constant(p.N, p.unknowns(), NAN);
  s.x = RowMatrix::Constant(p.N + 1, p.states(), NAN);
  s.x.row(0) = p.boundary.b.transpose();
  for (const GalerkinRun& run : p.runs) {
    march_run(p, run, backend, options, s);
    if (s.status != Status::solved) break;
  }
  return s;
}

}  // namespace bromwich
