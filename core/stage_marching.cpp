#include "core/stage_marching.hpp"

#include "core/march_outcome.hpp"
#include "core/timer.hpp"

#include <array>
#include <cmath>

namespace bromwich {

namespace {

constexpr double first_node = 1.0 / 3;  ///< c_1 of Radau IIA; the last node is the end of the step

// g or phi at the stages of every step: row j belongs to the step to t_j, row 0 holds the value at 0 in all stages.
RowMatrix sample_stages(const DiscreteProblem& p, const TimeFunction& function, const RowMatrix& at_nodes,
                        Index stages) {
  const Index width = at_nodes.cols();
  RowMatrix values(p.J + 1, stages * width);
  values.rightCols(width) = at_nodes;
  if (stages == 1) return values;
  Vector inner(p.J + 1);
  inner[0] = 0;
  for (Index j = 1; j <= p.J; ++j) inner[j] = p.t[j - 1] + first_node * p.h;
  values.leftCols(width) = sample(function, inner, width).table();
  return values;
}

SparseMatrix source_matrix(const Scene& scene, const Dynamics& dynamics) {
  if (scene.f_entry == SourceEntry::through_F) return scene.F;
  if (scene.f_entry == SourceEntry::through_B) {
    if (const auto* d = std::get_if<SparseDynamics>(&dynamics)) return d->B;
    return std::get<DenseDynamics>(dynamics).B.sparseView();
  }
  SparseMatrix identity(scene.states(), scene.states());
  identity.setIdentity();
  return identity;
}

std::string describe(Index stages, const MarchReport& report) {
  if (stages == 1) return "implicit Euler on the state";
  std::string text = "y discontinuous between steps: Radau IIA on the state";
  if (report.jumps > 0) text += ", " + std::to_string(report.jumps) + " steps by implicit Euler (the state jumps)";
  return text;
}

}  // namespace

void solve_by_stages(const DiscreteProblem& p, Index stages, const Options& options, Result& result) {
  Timer timer;
  const Index rows = p.J + 1, n = p.scene.constraints();
  const Dynamics written_out = p.kronecker() ? Dynamics(to_sparse(*p.kronecker())) : Dynamics();
  const auto array = [&](const RowMatrix& values) {
    auto on_backend = p.backend.array(values.rows(), values.cols());
    p.backend.upload(values, *on_backend);
    return on_backend;
  };
  StageProblem problem;
  problem.dynamics = p.kronecker() ? &written_out : &p.scene.dynamics;
  problem.M = &p.scene.M;
  problem.lcp_class = p.lcp_class;
  problem.stages = stages;
  problem.h = p.h;
  problem.x0 = p.scene.x0;
  problem.components = p.components;
  problem.interrupted = options.interrupted;
  if (options.progress) problem.progress = [&](Index step) { options.progress({step, 0, p.J}); };
  const auto g = array(sample_stages(p, p.scene.g, p.g.table(), stages));
  problem.g = g.get();
  std::unique_ptr<Array> phi;
  if (p.f.size() > 0) {
    phi = array(sample_stages(p, p.scene.f, p.f.table(), stages));
    problem.phi = phi.get();
    problem.F = source_matrix(p.scene, *problem.dynamics);
  }
  const auto march = p.backend.stage_march(problem, rows);
  const auto y = p.backend.array(rows, n), v = p.backend.array(rows, n), r = array(p.g.table());
  const auto x = p.backend.array(rows, Index(p.components.size()));
  result.bytes = 3 * y->bytes() + g->bytes() + (phi ? phi->bytes() : 0) + x->bytes() + march->bytes() + host_bytes(p);
  result.seconds.setup += timer.lap();

  const Start start = solve_at_zero(p, result);
  if (start == Start::none) return;
  p.backend.upload(result.y, *y);
  result.seconds.lcp += timer.lap();
  const MarchReport report = march->run(*y, *v, *x);
  p.backend.download(*y, result.y);
  p.backend.download(*x, result.x);
  result.continuous = false;
  result.well_posed = report.well_posed;
  result.kernel = describe(stages, report);
  if (start == Start::impulse) result.kernel += impulse_note;
  count(report, result);
  if (options.trace) result.trace = trace(p, *r, *v);
  if (report.stopped >= 0) return explain_stop(p, report, result);
  result.residual = march_residual(p, start, *r, *v, *y);
  result.status = Status::solved;
}

}  // namespace bromwich
