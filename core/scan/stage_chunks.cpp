#include "core/scan/stage_chunks.hpp"

#include "core/base/denormals.hpp"
#include "core/host/stage_steps.hpp"
#include "core/scan/coarse_start.hpp"
#include "core/scan/held_products.hpp"
#include "core/scan/stage_pieces.hpp"

#include <cmath>
#include <cstring>
#include <memory>

namespace bromwich {

namespace {

// Rows first..last of a problem; the first row is where it starts.
StageProblem rows_of(const StageProblem& p, Index first, Index last, const SharedStop& stop) {
  StageProblem part;
  part.dynamics = p.dynamics;
  part.M = p.M;
  part.lcp_class = p.lcp_class;
  part.stages = p.stages;
  part.h = p.h;
  part.F = p.F;
  part.components = p.components;
  part.substitutes_euler = p.substitutes_euler;
  part.g = p.g.middleRows(first, last - first + 1);
  if (p.phi.size() > 0) part.phi = p.phi.middleRows(first, last - first + 1);
  if (!p.lengths.empty()) part.lengths.assign(p.lengths.begin() + first, p.lengths.begin() + last);
  part.jumps_at_start = p.jumps_at_start && first == 0;
  part.interrupted = [&stop] { return stop(); };
  return part;
}

// What a step needs to know of those before it.
struct History {
  std::vector<bool> touching;
  Vector regular;
};

class Chunk {
 public:
  Chunk(const StageProblem& p, Index first, Index last, const SharedStop& stop)
      : first_(first), problem_(rows_of(p, first, last, stop)), asked_to_stop_(problem_) {}

  // Fills the rows behind the first one of `all`. `before`: null for the chunk that begins at x0 with y0.
  ChunkEnd march(const Vector& start, const Vector& y0, const History* before, bool with_derivative,
                 StageSolution& all) {
    const FlushDenormals flush;
    if (!steps_) steps_ = std::make_unique<host::StageSteps>(problem_);
    report = {};
    impacts.clear();
    const Vector seen = observe(*problem_.dynamics, start);
    before ? steps_->resume(before->touching, before->regular) : steps_->start(start, y0, seen);
    began_with = before ? *before : History{};
    report.well_posed = steps_->well_posed();
    product_.begin(with_derivative ? start.size() : 0);
    Vector x = start, next(x.size()), size = Vector::Zero(x.size());
    for (Index j = 1; j < problem_.g.rows(); ++j) {
      const host::Stepper* used = asked_to_stop_(j, report) ? nullptr : steps_->take(x, j, next, report);
      if (!used) return {};
      if (j == 1 && !before && !y0.allFinite()) all.y.row(0) = used->first_stage().transpose();
      if (with_derivative) multiply(*used);
      steps_->pass(*used);
      if (used->stages() != problem_.stages && steps_->impact()) impacts.push_back(first_ + j);
      x.swap(next);
      size = size.cwiseMax(x.cwiseAbs());
      record(x, j, *used, all);
    }
    return {x, size, with_derivative ? product_.product() : Matrix(), with_derivative ? product_.sets() : 0, true};
  }

  History after() const { return {steps_->touching, steps_->own_regular()}; }
  bool takes_the_same(const History& before) const {
    return before.touching == began_with.touching && steps_->same_before().has(before.regular);
  }
  std::size_t bytes() const {
    return (steps_ ? steps_->bytes() : 0) + sizeof(double) * std::size_t(problem_.g.size() + problem_.phi.size());
  }

  MarchReport report;
  std::vector<Index> impacts;
  History began_with;

 private:
  // By the derivative of a step that has been taken.
  void multiply(const host::Stepper& used) {
    key_.clear();
    std::uint64_t length = 0;
    const double h = used.length();
    std::memcpy(&length, &h, sizeof length);
    key_.push_back(length);
    key_.push_back(std::uint64_t(used.stages()));
    append_positive(used.Y, key_);
    product_.step(key_, [&] {
      const host::DenseStageMaps& maps = *used.step().maps();
      return Matrix(maps.decay + maps.drive * Matrix(held_solution(used.matrix(), used.Y) * maps.see));
    });
  }

  void record(const Vector& x, Index j, const host::Stepper& used, StageSolution& all) const {
    const Index row = first_ + j;
    all.y.row(row) = used.last_stage().transpose();
    all.impulse.row(row) = steps_->length(j) * used.mean().transpose();
    all.v.row(row) = observe(*problem_.dynamics, x).transpose();
    for (std::size_t c = 0; c < problem_.components.size(); ++c) all.x(row, Index(c)) = x[problem_.components[c]];
  }

  Index first_;
  StageProblem problem_;
  host::Poll asked_to_stop_;
  std::unique_ptr<host::StageSteps> steps_;  ///< made in the first pass, by its thread
  HeldProduct product_;
  SetKey key_;
};

class StageChunks final : public Chunks {
 public:
  StageChunks(const StageProblem& p, const Vector& y0, const std::vector<Index>& rows, const SharedStop& stop)
      : y0_(y0), rows_(rows) {
    const Index J = p.g.rows() - 1, n = y0.size();
    for (RowMatrix* values : {&all_.y, &all_.impulse, &all_.v}) values->resize(J + 1, n);
    all_.x.resize(J + 1, Index(p.components.size()));
    all_.y.row(0) = y0.transpose();
    all_.impulse.row(0).setZero();
    all_.v.row(0) = observe(*p.dynamics, p.x0).transpose();
    for (std::size_t c = 0; c < p.components.size(); ++c) all_.x(0, Index(c)) = p.x0[p.components[c]];
    for (std::size_t c = 0; c + 1 < rows.size(); ++c)
      chunks_.push_back(std::make_unique<Chunk>(p, rows[c], rows[c + 1], stop));
    const Vector before = y0.allFinite() ? y0 : Vector(Vector::Zero(n));
    before_.assign(chunks_.size(), {std::vector<bool>(std::size_t(n), false), before});
  }

  // The first guess of the constraints that touch, and of the sizes of y.
  void expect(const std::vector<Vector>& y) {
    for (std::size_t c = 1; c < chunks_.size(); ++c) {
      for (Index i = 0; i < y0_.size(); ++i) before_[c].touching[std::size_t(i)] = y[c][i] > 0;
      before_[c].regular = before_[c - 1].regular.cwiseMax(y[c]);
    }
  }

  Index count() const override { return Index(chunks_.size()); }

  ChunkEnd march(Index c, const Vector& start, bool with_derivative) override {
    const std::size_t i = std::size_t(c);
    return chunks_[i]->march(start, y0_, c == 0 ? nullptr : &before_[i], with_derivative, all_);
  }

  bool hand_over(Index c) override {
    if (c == 0) return false;
    const std::size_t i = std::size_t(c);
    const History last = chunks_[i - 1]->after();
    before_[i] = {last.touching, before_[i - 1].regular.cwiseMax(last.regular)};
    return !chunks_[i]->takes_the_same(before_[i]);
  }

  StageSolution take(const ScanReport& scan, int threads) {
    const Index known = scan.stopped >= 0 ? scan.stopped + 1 : Index(chunks_.size());
    all_.report.well_posed = chunks_.front()->report.well_posed;
    for (Index c = 0; c < known; ++c) add(*chunks_[std::size_t(c)], rows_[std::size_t(c)]);
    all_.report.lcp_seconds /= threads;
    for (const auto& chunk : chunks_) all_.bytes += chunk->bytes();
    if (scan.interrupted) {
      all_.report.interrupted = true;
      all_.report.stopped = 1;
    }
    if (all_.report.stopped < 0) return std::move(all_);
    const Index unknown = all_.y.rows() - all_.report.stopped;
    for (RowMatrix* values : {&all_.y, &all_.impulse, &all_.v, &all_.x}) values->bottomRows(unknown).setConstant(NAN);
    return std::move(all_);
  }

 private:
  void add(const Chunk& chunk, Index first) {
    MarchReport& sum = all_.report;
    const MarchReport& part = chunk.report;
    sum.count += part.count;
    sum.jumps += part.jumps;
    sum.finite = sum.finite && part.finite;
    sum.lcp_seconds += part.lcp_seconds;
    if (part.stopped >= 0) sum.stopped = first + part.stopped;
    if (part.infeasible >= 0) sum.infeasible = first + part.infeasible;
    all_.impacts.insert(all_.impacts.end(), chunk.impacts.begin(), chunk.impacts.end());
  }

  const Vector y0_;
  const std::vector<Index> rows_;
  std::vector<std::unique_ptr<Chunk>> chunks_;
  std::vector<History> before_;
  StageSolution all_;
};

// Times of the rows, and g and phi at them.
CoarseInput at_rows(const StageProblem& p) {
  const Index J = p.g.rows() - 1, n = p.g.cols() / p.stages, k = p.phi.cols() / p.stages;
  CoarseInput in{p.dynamics, p.M, p.lcp_class, p.F, p.x0, Vector(J + 1), p.g.rightCols(n), {}};
  in.t[0] = 0;
  for (Index j = 1; j <= J; ++j)
    in.t[j] = p.lengths.empty() ? double(j) * p.h : in.t[j - 1] + p.lengths[std::size_t(j) - 1];
  if (p.phi.size() > 0) in.phi = p.phi.rightCols(k);
  return in;
}

}  // namespace

StageSolution march_in_chunks(const StageProblem& p, const Vector& y0, const ScanPlan& plan, ScanReport& report) {
  const Index J = p.g.rows() - 1;
  const std::vector<Index> rows = first_rows(chunks_of(plan, J), J);
  const SharedStop stop(plan.interrupted);
  if (plan.by_pieces)
    if (auto solution = march_stages_by_pieces(p, y0, plan, stop, report)) return std::move(*solution);
  if (rows.size() == 2) {
    report.chunks = report.passes = 1;
    return march_by_stages(p, y0);
  }
  StageChunks chunks(p, y0, rows, stop);
  CoarseStates first = coarse_states(
      plan, rows, [&] { return at_rows(p); }, p.x0, y0.size());
  chunks.expect(first.y);
  const Index longest = (J + chunks.count() - 1) / chunks.count();
  report = solve_chunks(chunks, std::move(first.x), longest, *plan.threads, stop);
  return chunks.take(report, plan.threads->threads());
}

}  // namespace bromwich
