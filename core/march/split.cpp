#include "core/march/split.hpp"

#include "core/base/denormals.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/kernel/weight_check.hpp"
#include "core/march/outcome.hpp"
#include "core/march/split_pieces.hpp"
#include "core/scan/coarse_start.hpp"

#include <cmath>
#include <memory>

namespace bromwich {

namespace {

struct SplitRows {
  RowMatrix y, impulse, x;  ///< (J+1) x n, n and m: impulse is that of each step
  RowMatrix defects;        ///< one row in R^m for each rough step
};

// A march over the rows behind the first one, up to the last one.
class SplitChunk {
 public:
  SplitChunk(const SplitRule& rule, Index first, Index last) : rule_(rule), first_(first), last_(last), steps_(rule) {}

  // Null progress for chunks beside others.
  bool march(const Vector& x, const Vector& y, bool with_derivative, const host::Poll& asked_to_stop, SplitRows& rows) {
    const FlushDenormals flush;
    report = {};
    report.well_posed = rule_.well_posed();
    largest_x = Vector::Zero(x.size());
    largest_y = Vector::Zero(y.size());
    steps_.start(first_, x, y, with_derivative);
    for (Index j = first_ + 1; j <= last_; ++j) {
      if (asked_to_stop(j, report) || !steps_.take(j, report)) return false;
      largest_x = largest_x.cwiseMax(steps_.x().cwiseAbs());
      largest_y = largest_y.cwiseMax(steps_.y());
      rows.x.row(j) = steps_.x().transpose();
      rows.y.row(j) = steps_.y().transpose();
      rows.impulse.row(j) = steps_.impulse().transpose();
      if (steps_.in_parts()) rows.defects.row(place_of(j)) = steps_.defect().transpose();
    }
    return true;
  }

  SplitSteps& steps() { return steps_; }
  MarchReport report;
  Vector largest_x, largest_y;

 private:
  Index place_of(Index j) const { return rule_.p.sources->at(j) - rule_.p.sources->rough.data(); }

  const SplitRule& rule_;
  Index first_, last_;
  SplitSteps steps_;
};

// Their state is (x, y).
class SplitChunks final : public Chunks {
 public:
  SplitChunks(const SplitRule& rule, const std::vector<Index>& rows, const SharedStop& stop, SplitRows& all)
      : m_(rule.d.A.rows()), asked_to_stop_([&stop] { return stop(); }, {}), all_(all) {
    for (std::size_t c = 0; c + 1 < rows.size(); ++c)
      chunks_.push_back(std::make_unique<SplitChunk>(rule, rows[c], rows[c + 1]));
  }

  Index count() const override { return Index(chunks_.size()); }

  ChunkEnd march(Index c, const Vector& start, bool with_derivative) override {
    SplitChunk& chunk = *chunks_[std::size_t(c)];
    const Index n = start.size() - m_;
    if (!chunk.march(start.head(m_), start.tail(n), with_derivative, asked_to_stop_, all_)) return {};
    SplitSteps& steps = chunk.steps();
    ChunkEnd end{Vector(start.size()), Vector(start.size()), {}, 0, true};
    end.s << steps.x(), steps.y();
    end.size << chunk.largest_x, chunk.largest_y;
    if (!with_derivative) return end;
    end.D = steps.derivative();
    end.sets = steps.sets();
    return end;
  }

  MarchReport report(const ScanReport& scan, int threads) const {
    MarchReport sum = chunks_.front()->report;
    const Index known = scan.stopped >= 0 ? scan.stopped + 1 : count();
    for (Index c = 1; c < known; ++c) {
      const MarchReport& part = chunks_[std::size_t(c)]->report;
      sum.count += part.count;
      sum.finite = sum.finite && part.finite;
      sum.lcp_seconds += part.lcp_seconds;
      sum.stopped = part.stopped;
      sum.infeasible = part.infeasible;
    }
    sum.lcp_seconds /= threads;
    if (!scan.interrupted) return sum;
    sum.interrupted = true;
    sum.stopped = 1;
    return sum;
  }

 private:
  Index m_;
  host::Poll asked_to_stop_;
  std::vector<std::unique_ptr<SplitChunk>> chunks_;
  SplitRows& all_;
};

MarchReport march_in_turn(const SplitRule& rule, const Options& options, SplitRows& all) {
  const auto progress = [&options, J = rule.p.J](Index j) {
    if (options.progress) options.progress({j, 0, J});
  };
  SplitChunk chunk(rule, 0, rule.p.J);
  chunk.march(rule.p.scene.x0, all.y.row(0).transpose(), false, host::Poll(options.interrupted, progress), all);
  return chunk.report;
}

MarchReport march_in_chunks(const SplitRule& rule, const ScanPlan& plan, const Options& options, SplitRows& all,
                            ScanReport& scan) {
  const DiscreteProblem& p = rule.p;
  // Where a step has several solutions, the one taken follows from all active sets before.
  const std::vector<Index> rows = first_rows(rule.well_posed() ? chunks_of(plan, p.J) : 1, p.J);
  const SharedStop stop(plan.interrupted);
  if (plan.by_pieces && march_split_by_pieces(rule, plan, stop, all.x, all.y, scan)) {
    MarchReport report;
    report.well_posed = rule.well_posed();
    report.count.solved = long(p.J);
    report.lcp_seconds = scan.seconds;
    return report;
  }
  if (rows.size() == 2) {
    scan.chunks = scan.passes = 1;
    return march_in_turn(rule, options, all);
  }
  SplitChunks chunks(rule, rows, stop, all);
  const auto input = [&] {
    CoarseInput in{&p.scene.dynamics, &p.scene.M, p.lcp_class, {}, p.scene.x0, p.t, rule.g, {}};
    if (p.f.size() == 0) return in;
    in.F = source_matrix(p).sparseView();
    in.phi = p.f.table();
    return in;
  };
  CoarseStates first = coarse_states(plan, rows, input, p.scene.x0, rule.n);
  first.y[0] = all.y.row(0).transpose();
  std::vector<Vector> starts;
  for (std::size_t c = 0; c < first.x.size(); ++c) {
    starts.emplace_back(first.x[c].size() + first.y[c].size());
    starts.back() << first.x[c], first.y[c];
  }
  scan = solve_chunks(chunks, std::move(starts), (p.J + chunks.count() - 1) / chunks.count(), *plan.threads, stop);
  return chunks.report(scan, plan.threads->threads());
}

// r = g and v = N x as backend arrays: residual and trace are computed as for every march.
void look_at(const DiscreteProblem& p, const Options& options, const RowMatrix& x, Result& result) {
  RowMatrix known = p.g.table(), seen = x * p.small_state()->N.transpose();
  known.row(0) = p.start.transpose();
  seen.row(0).setZero();
  const auto array = [&](const RowMatrix& values) {
    auto on_backend = p.backend.array(values.rows(), values.cols());
    p.backend.upload(values, *on_backend);
    return on_backend;
  };
  const auto r = array(known), v = array(seen), y = array(result.y);
  if (options.trace) result.trace = trace(p, *r, *v);
  if (result.y.allFinite()) result.residual = march_residual(p, Start::found, *r, *v, *y);
}

void describe(const DiscreteProblem& p, const WeightCheck& check, Result& result) {
  result.kernel_error = check.error;
  result.kernel = "state of the scene, stepped by the matrix exponential" +
                  (check.against.empty() ? "" : ", checked against " + check.against);
  if (!p.sources) return;
  result.kernel += text("; %zu steps in parts, where sources are not smooth", p.sources->rough.size());
}

// The integral of y and what parts contribute to x, as the usual march leaves them out.
void keep_parts(const DiscreteProblem& p, SplitRows& rows, Result& result) {
  if (!p.sources) return;
  for (Index j = 1; j <= p.J; ++j) rows.impulse.row(j) += rows.impulse.row(j - 1);
  result.y_integral = std::move(rows.impulse);
  const auto defects = std::make_shared<StepDefects>();
  for (const RoughStep& rough : p.sources->rough) defects->steps.push_back(rough.step);
  defects->values = std::move(rows.defects);
  result.defects = defects;
}

SplitRows rows_for(const DiscreteProblem& p, const RowMatrix& y) {
  const Index rows = p.J + 1, m = p.scene.states(), n = p.scene.constraints();
  SplitRows all{y, RowMatrix::Constant(rows, n, NAN), RowMatrix::Constant(rows, m, NAN), {}};
  all.impulse.row(0).setZero();
  all.x.row(0) = p.scene.x0.transpose();
  if (p.sources) all.defects = RowMatrix::Constant(Index(p.sources->rough.size()), m, NAN);
  return all;
}

}  // namespace

void solve_by_split_marching(const DiscreteProblem& p, const Options& options, Result& result, const ScanPlan* plan) {
  Timer timer;
  const double m = double(p.scene.states()), n = double(p.scene.constraints());
  describe(p,
           check_weights(p, dense_recurrence(*p.small_state(), *state_step(p, Rule::exponential)),
                         double(p.J) * (m * m + 2 * m * n)),
           result);
  const SplitRule rule(p);
  result.seconds.setup += timer.lap();
  const Start start = solve_at_zero(p, result);
  if (start == Start::none) return;
  if (start == Start::impulse) {
    result.status = Status::unsupported;
    result.reason = "x0 violates the constraints and y has to jump; use method march or auto";
    return;
  }
  result.seconds.lcp += timer.lap();
  SplitRows rows = rows_for(p, result.y);
  ScanReport scan;
  const MarchReport report =
      plan ? march_in_chunks(rule, *plan, options, rows, scan) : march_in_turn(rule, options, rows);
  if (report.stopped >= 0)
    for (RowMatrix* values : {&rows.y, &rows.impulse, &rows.x})
      values->bottomRows(p.J + 1 - report.stopped).setConstant(NAN);
  result.y = std::move(rows.y);
  keep_parts(p, rows, result);
  result.x = rows.x(Eigen::all, p.components);
  result.bytes = sizeof(double) * std::size_t(2 * result.y.size() + rows.x.size()) + host_bytes(p);
  count(report, result);
  if (plan) tell(scan, result);
  result.well_posed = report.well_posed;
  look_at(p, options, rows.x, result);
  if (report.stopped >= 0) return explain_stop(p, report, result);
  result.status = Status::solved;
}

}  // namespace bromwich
