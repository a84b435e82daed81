#include "core/multigrid/dual.hpp"

#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/dual/local_march.hpp"
#include "core/lcp/entries.hpp"
#include "core/march/outcome.hpp"
#include "core/multigrid/dual_levels.hpp"
#include "core/multigrid/multigrid.hpp"
#include "core/result/notice.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

namespace bromwich {

namespace {

// max_j |a_j - b_j|_inf / max(1, |a_j|_inf) from row 1 on, the measure of all estimates.
double relative_distance(const RowMatrix& a, const RowMatrix& b) {
  double largest = 0;
  for (Index j = 1; j < a.rows(); ++j)
    largest = std::max(largest, (a.row(j) - b.row(j)).cwiseAbs().maxCoeff<Eigen::PropagateNaN>() /
                                    std::max(1.0, a.row(j).cwiseAbs().maxCoeff()));
  return largest;
}

RowMatrix every(const RowMatrix& rows, Index stride) {
  return rows(Eigen::seq(0, rows.rows() - 1, stride), Eigen::all);
}

// Cycles of one rule.
class DualRun {
 public:
  DualRun(TimeOperator& op, const Options& options, std::unique_ptr<DualLevels> dual)
      : op_(op),
        p_(op.problem()),
        dual_(std::move(dual)),
        stages_(dual_->stages),
        multigrid_(p_.backend, options, dual_->levels),
        at_rest_(p_.scene.x0.isZero(0)) {
    for (auto* array : {&r_, &y_, &v_}) *array = p_.backend.array(stages_ * p_.J + 1, p_.scene.constraints());
    dual_->finest->respond({}, *r_);
  }

  // A body at rest at the start contributes nothing to s.
  void renew(const Changes& changes) {
    const bool was_at_rest = std::exchange(at_rest_, p_.scene.x0.isZero(0));
    if (!changes.sources && was_at_rest && at_rest_) return;
    dual_->levels.kernel_error = dual_->levels.take_sources(changes);
    dual_->finest->respond(changes, *r_);
    used_ = false;
  }

  void run(Start start, const Vector& y0, const Options& options, Result& result) {
    Timer timer;
    TimeLevels& levels = dual_->levels;
    result.form = "dual";
    result.kernel = levels.description;
    result.kernel_error = levels.kernel_error;
    result.bytes += bytes();
    if (used_) levels.respond();  // cycles have written to r of the coarse grids
    used_ = true;
    multigrid_.begin(options, result);
    multigrid_.nest(first_gap(start, y0));
    start_on_coarse_grids(levels);
    const IterationOutcome outcome = multigrid_.iterate();
    result.seconds.sweeps = timer.lap();
    result.status = outcome.status;
    result.reason = outcome.reason;
    finish(start, y0, options, result);
    for (auto& level : levels.grids) {
      result.seconds.transform += level->kernel->transform_seconds;
      result.seconds.convolution += level->kernel->convolution_seconds;
    }
  }

  Index stages() const { return stages_; }

 private:
  std::size_t bytes() const {
    std::size_t sum = host_bytes(p_) + op_.bytes_of_tables() + 3 * r_->bytes();
    for (const auto& level : dual_->levels.grids) sum += level->bytes();
    for (const auto& grid : dual_->grids) sum += grid.response ? grid.response->bytes() : 0;
    for (const auto& s : dual_->s) sum += s ? s->bytes() : 0;
    return sum;
  }

  // w at t = 0. Where the state jumps, it is only the start of the interpolation.
  Vector first_gap(Start start, const Vector& y0) const {
    if (start == Start::impulse) return p_.start.cwiseMax(0);
    return (p_.start + multiply(p_.scene.M, y0)).cwiseMax(0);
  }

  // y = max(0, V w + s) of grid l.
  RowMatrix y_of(std::size_t l, const Array& w) {
    TimeLevel& level = dual_->levels[l];
    level.kernel->apply(w, *level.v, 0);
    p_.backend.add(*level.v, 1, dual_->s[l] ? *dual_->s[l] : *level.r, *level.v);
    RowMatrix y;
    p_.backend.download(*level.v, y);
    if (!is_zero(dual_->P[l])) {
      RowMatrix values;
      p_.backend.download(w, values);
      y += times_rows(dual_->P[l], values);
    }
    y = y.cwiseMax(0);
    if (dual_->row_scale.size() > 0) y = (y * dual_->row_scale.asDiagonal()).eval();
    return y;
  }

  // y of the two grids below the finest, from the nested iteration, at the ends of their steps.
  void start_on_coarse_grids(TimeLevels& levels) {
    for (std::size_t l = 1; l <= 2; ++l)
      coarse_y_[l - 1] =
          levels.estimates() ? every(y_of(l, stages_ == 2 ? *levels[l].y : *levels[l].nested), stages_) : RowMatrix();
  }

  void finish(Start start, const Vector& y0, const Options& options, Result& result) {
    RowMatrix y = y_of(0, *dual_->levels[0].y);
    if (start == Start::impulse) {
      y.row(0) = y.row(1);
      result.kernel += impulse_note;
      result.starts_with_impulse = true;
    } else {
      y.row(0) = y0.transpose();
    }
    result.y = every(y, stages_);
    result.continuous = stages_ == 1;
    if (result.status == Status::interrupted || result.status == Status::nonfinite) {
      result.y.bottomRows(p_.J).setConstant(NAN);
      return;
    }
    p_.backend.upload(y, *y_);
    p_.backend.upload(RowMatrix::Zero(1, y.cols()), *y_);  // the rules do not use row 0
    dual_->finest->apply(*y_, *v_);
    p_.backend.upload(y.topRows(1), *y_);
    judge(start, options, result);
    if (stages_ == 2) record_steps(y, result);
    // Other operators than those of sparse dynamics have the states of implicit Euler.
    if (stages_ == 1 && !p_.small_state() && !p_.modes() && !p_.components.empty())
      result.x = stage_states(p_, 1, y, p_.components);
    result.well_posed = true;  // V_0 is the inverse of a P-matrix
    if (result.status == Status::solved) estimate(result);
  }

  // Trace at the ends of steps; the residual of all stages.
  void judge(Start start, const Options& options, Result& result) {
    if (stages_ == 1) {
      if (options.trace) result.trace = trace(p_, *r_, *v_);
      result.residual = march_residual(p_, start, *r_, *v_, *y_);
      return;
    }
    if (options.trace) {
      const auto r = p_.backend.array(p_.J + 1, p_.scene.constraints()), v = p_.backend.array(r->rows(), r->cols());
      p_.backend.inject(*r_, *r);
      p_.backend.inject(*v_, *v);
      result.trace = trace(p_, *r, *v);
    }
    // The residual does not depend on the class, and devices have plans for P.
    const bool banded = std::holds_alternative<Tridiagonal>(p_.scene.M);
    if (!residual_) residual_ = p_.backend.lcp(p_.scene.M, banded ? LcpClass::P : p_.lcp_class, r_->rows());
    result.residual = residual_->residual(*r_, *v_, *y_);
  }

  // What marching in stages records: integrals of y by the weights 3/4 and 1/4, and the state.
  void record_steps(const RowMatrix& y, Result& result) const {
    result.y_integral = RowMatrix::Zero(p_.J + 1, y.cols());
    for (Index j = 1; j <= p_.J; ++j)
      result.y_integral.row(j) = result.y_integral.row(j - 1) + p_.h * (0.75 * y.row(2 * j - 1) + 0.25 * y.row(2 * j));
    std::vector<Index> components = p_.components;
    if (p_.scene.states() <= most_recorded_by_dual) {
      components.resize(std::size_t(p_.scene.states()));
      std::iota(components.begin(), components.end(), Index(0));
    }
    if (!components.empty()) result.x = stage_states(p_, 2, y, components);
  }

  // As Multigrid::discretisation_error does it for its unknown: with y of the next two grids, at most order 2.
  void estimate(Result& result) const {
    if (coarse_y_[0].size() == 0) return;
    constexpr double least_ratio = 1.41421356;
    const double last = relative_distance(every(result.y, 2), coarse_y_[0]),
                 before = relative_distance(every(coarse_y_[0], 2), coarse_y_[1]);
    const double ratio = last > 0 ? before / last : 4;
    if (ratio > least_ratio) result.error_estimate = last / (std::min(ratio, 4.0) - 1);
  }

  TimeOperator& op_;
  const DiscreteProblem& p_;
  std::unique_ptr<DualLevels> dual_;
  Index stages_;
  Multigrid multigrid_;
  std::unique_ptr<Array> r_, y_, v_;
  std::unique_ptr<LcpBatch> residual_;  ///< made when first needed
  RowMatrix coarse_y_[2];
  bool at_rest_, used_ = false;
};

// Cycles of the rule chosen, and those of implicit Euler where that rule does not serve:
// - the state jumps at the start: implicit Euler moves it onto the constraints at once, Radau IIA does not;
// - cycles at the stages do not contract: with M = 0 this is seen for c h / dx^2 below about 1e-3 (docs/dual.md).
class PreparedDual final : public PreparedMethod {
 public:
  PreparedDual(TimeOperator& op, const Options& options, std::unique_ptr<DualLevels> dual)
      : op_(op), main_(std::make_unique<DualRun>(op, options, std::move(dual))), at_zero_(op.problem()) {}

  void renew(const Changes& changes) override {
    at_zero_.renew();  // first: it waits for a device
    if (!changes.any()) return;
    main_->renew(changes);
    if (euler_) euler_->renew(changes);
  }

  void run(const Options& options, Result& result) override {
    Vector y0;
    const Start start = at_zero_.solve(result, y0);
    if (start == Start::none) return;
    if (main_->stages() == 1) return main_->run(start, y0, options, result);
    std::string refusal;
    if (start == Start::impulse) {
      if (DualRun* euler = by_euler(options, refusal)) return euler->run(start, y0, options, result);
      result.status = Status::unsupported;
      result.reason = "the state jumps at t = 0, which needs cycles of implicit Euler: " + refusal;
      return;
    }
    Result staged = result;
    main_->run(start, y0, options, staged);
    DualRun* euler = staged.status == Status::tolerance_not_met ? by_euler(options, refusal) : nullptr;
    if (euler) {
      Result first_order = result;
      euler->run(start, y0, options, first_order);
      if (first_order.status == Status::solved) {
        result = std::move(first_order);
        return tell(result, {NoticeCode::first_order});
      }
    }
    result = std::move(staged);
  }

 private:
  // Made when first needed; null, with the reason, where it does not exist.
  DualRun* by_euler(const Options& options, std::string& refusal) {
    if (!euler_) {
      auto levels = dual_levels(op_, 1, options);
      if (levels->levels.size() == 0)
        refusal = levels->refusal;
      else
        euler_ = std::make_unique<DualRun>(op_, options, std::move(levels));
    }
    return euler_.get();
  }

  TimeOperator& op_;
  std::unique_ptr<DualRun> main_, euler_;
  ProblemAtZero at_zero_;
};

// Rough sources are averaged over steps, which implicit Euler takes; dense dynamics have no stages.
bool takes_stages(const DiscreteProblem& p, const Options& options) {
  return !options.tuning.dual_by_euler && !p.small_state() && !p.sources &&
         (p.f.size() == 0 || !p.modes() || p.drive());
}

constexpr double slow_forecast = 0.6;  ///< contraction of cycles with stages above which implicit Euler is taken
constexpr double no_contraction = 1;   ///< forecast of cycles that are not begun

}  // namespace

std::unique_ptr<PreparedMethod> prepare_dual(TimeOperator& op, const Options& options, std::string& why) {
  if (!options.tuning.dual_by_euler && has_local_inverse(op.problem())) return prepare_local_march(op.problem());
  if (op.problem().modes() && !op.problem().modes()->beside.empty()) {
    why = "the inverse of the kernel of a box with contact on a face has no plans";
    return nullptr;
  }
  std::unique_ptr<DualLevels> levels;
  if (takes_stages(op.problem(), options)) levels = dual_levels(op, 2, options);
  if (!levels || levels->levels.size() == 0 || levels->contraction > slow_forecast)
    levels = dual_levels(op, 1, options);
  if (levels->levels.size() == 0) {
    why = levels->refusal;
    return nullptr;
  }
  if (levels->contraction >= no_contraction) {
    why = text("cycles are forecast not to contract (%.2f a cycle)", levels->contraction);
    return nullptr;
  }
  return std::make_unique<PreparedDual>(op, options, std::move(levels));
}

}  // namespace bromwich
