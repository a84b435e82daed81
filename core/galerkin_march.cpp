#include "core/galerkin_recurrence.hpp"
#include "core/galerkin_solvers.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/text.hpp"

namespace bromwich {

namespace {

void explain(const GalerkinProblem& p, const MarchReport& report, GalerkinSolution& s) {
  if (report.stopped < 0) {
    s.status = Status::solved;
    return;
  }
  const std::string where = text("in the interval that begins at t = %.6g", double(report.stopped - 1) * p.h);
  if (report.interrupted) {
    s.status = Status::interrupted;
    s.reason = "stopped on request " + where;
  } else if (!report.finite) {
    s.status = Status::nonfinite;
    s.reason = "the solution is not finite " + where;
  } else if (report.infeasible >= 0) {
    s.status = Status::infeasible;
    s.infeasible = report.infeasible - 1;
    s.reason = "no solution " + where;
  } else {
    s.reason = "the complementarity problem stayed unsolved " + where + "; try other steps";
  }
}

}  // namespace

GalerkinSolution march_galerkin(const GalerkinProblem& p, Backend& backend, const Options& options) {
  const LcpMatrix D = p.step.D;
  const Recurrence recurrence = galerkin_recurrence(p.step);
  const auto q = padded_array(p.q, backend), forcing = padded_array(p.forcing, backend);
  MarchProblem problem;
  problem.M = &D;
  problem.lcp_class = classify(D);
  problem.recurrence = &recurrence;
  problem.r = q.get();
  problem.start = &p.boundary.b;
  problem.forcing = forcing.get();
  problem.interrupted = options.interrupted;
  if (options.progress) problem.progress = [&options, N = p.N](Index step) { options.progress({step, 0, N}); };
  const auto y = backend.array(p.N + 1, p.unknowns()), v = backend.array(p.N + 1, p.unknowns());
  const auto march = backend.march(problem, p.N + 1);
  const MarchReport report = march->run(*y, *v);

  GalerkinSolution s;
  RowMatrix z;
  backend.download(*y, z);
  s.z = z.bottomRows(p.N);
  s.x = galerkin_states(p, s.z);
  s.how = "interval by interval";
  s.iterations = 1;
  s.unique = problem.lcp_class == LcpClass::P;
  s.lcp = report.count;
  s.lcp_seconds = report.lcp_seconds;
  s.bytes = q->bytes() + forcing->bytes() + y->bytes() + v->bytes() + march->bytes();
  explain(p, report, s);
  return s;
}

}  // namespace bromwich
