#include "core/galerkin_solvers.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/text.hpp"

namespace bromwich {

namespace {

// As a recurrence of the engine: row j = interval j, z_j the state at its right end.
class GalerkinRecurrence {
 public:
  GalerkinRecurrence(const GalerkinProblem& p, Backend& backend) {
    const Index m = p.states(), n = p.unknowns();
    recurrence = DenseRecurrence{p.step.E, p.step.H, Matrix::Zero(m, n), p.step.C, Matrix::Zero(n, n)};
    M = p.step.D;
    start = p.boundary.b;
    r = padded(p.q, backend);
    forcing = padded(p.forcing, backend);
    bytes = r->bytes() + forcing->bytes();
  }

  Recurrence recurrence;
  LcpMatrix M;
  Vector start;
  std::unique_ptr<Array> r, forcing;
  std::size_t bytes;

 private:
  static std::unique_ptr<Array> padded(const RowMatrix& values, Backend& backend) {
    RowMatrix rows = RowMatrix::Zero(values.rows() + 1, values.cols());
    rows.bottomRows(values.rows()) = values;
    auto array = backend.array(rows.rows(), rows.cols());
    backend.upload(rows, *array);
    return array;
  }
};

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
  const GalerkinRecurrence g(p, backend);
  MarchProblem problem;
  problem.M = &g.M;
  problem.lcp_class = classify(g.M);
  problem.recurrence = &g.recurrence;
  problem.r = g.r.get();
  problem.start = &g.start;
  problem.forcing = g.forcing.get();
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
  s.bytes = g.bytes + y->bytes() + v->bytes() + march->bytes();
  explain(p, report, s);
  return s;
}

}  // namespace bromwich
