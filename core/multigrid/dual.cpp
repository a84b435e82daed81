#include "core/multigrid/dual.hpp"

#include "core/base/timer.hpp"
#include "core/march/outcome.hpp"
#include "core/multigrid/dual_levels.hpp"
#include "core/multigrid/multigrid.hpp"

#include <algorithm>
#include <cmath>
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

class PreparedDual final : public PreparedMethod {
 public:
  PreparedDual(TimeOperator& op, const Options& options, std::unique_ptr<DualLevels> dual)
      : op_(op),
        p_(op.problem()),
        dual_(std::move(dual)),
        multigrid_(p_.backend, options, dual_->levels),
        at_zero_(p_) {
    for (auto* array : {&r_, &y_, &v_}) *array = p_.backend.array(p_.J + 1, p_.scene.constraints());
    dual_->finest->respond({}, *r_);
  }

  void renew(const Changes& changes) override {
    at_zero_.renew();  // first: it waits for a device
    if (!changes.any()) return;
    dual_->levels.kernel_error = dual_->levels.take_sources(changes);
    dual_->finest->respond(changes, *r_);
    used_ = false;
  }

  void run(const Options& options, Result& result) override {
    Timer timer;
    TimeLevels& levels = dual_->levels;
    result.form = "dual";
    result.kernel = levels.description;
    result.kernel_error = levels.kernel_error;
    result.bytes += bytes();
    if (used_) levels.respond();  // cycles have written to r of the coarse grids
    used_ = true;
    multigrid_.begin(options, result);
    Vector y0;
    const Start start = at_zero_.solve(result, y0);
    if (start == Start::none) return;
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

 private:
  std::size_t bytes() const {
    std::size_t sum = host_bytes(p_) + op_.bytes_of_tables() + 3 * r_->bytes();
    for (const auto& level : dual_->levels.grids) sum += level->bytes();
    for (const auto& grid : dual_->grids) sum += grid.response->bytes();
    for (const RowMatrix& s : dual_->s) sum += sizeof(double) * std::size_t(s.size());
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
    RowMatrix values, far;
    p_.backend.download(w, values);
    p_.backend.download(*level.v, far);
    return (times_rows(dual_->P[l], values) + far + dual_->s[l]).cwiseMax(0);
  }

  // y of the two grids below the finest, from the nested iteration.
  void start_on_coarse_grids(TimeLevels& levels) {
    for (std::size_t l = 1; l <= 2; ++l)
      coarse_y_[l - 1] = levels.size() > 2 ? y_of(l, *levels[l].nested) : RowMatrix();
  }

  void finish(Start start, const Vector& y0, const Options& options, Result& result) {
    result.y = y_of(0, *dual_->levels[0].y);
    if (start == Start::impulse) {
      result.y.row(0) = result.y.row(1);
      result.kernel += impulse_note;
      result.starts_with_impulse = true;
    } else {
      result.y.row(0) = y0.transpose();
    }
    if (result.status == Status::interrupted || result.status == Status::nonfinite) {
      result.y.bottomRows(p_.J).setConstant(NAN);
      return;
    }
    RowMatrix acting = result.y;
    acting.row(0).setZero();  // implicit Euler does not use it
    p_.backend.upload(acting, *y_);
    dual_->finest->apply(*y_, *v_);
    p_.backend.upload(result.y, *y_);
    if (options.trace) result.trace = trace(p_, *r_, *v_);
    result.residual = march_residual(p_, start, *r_, *v_, *y_);
    result.well_posed = true;  // V_0 is the inverse of a P-matrix
    if (result.status == Status::solved) estimate(result);
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
  Multigrid multigrid_;
  ProblemAtZero at_zero_;
  std::unique_ptr<Array> r_, y_, v_;
  RowMatrix coarse_y_[2];
  bool used_ = false;
};

}  // namespace

std::unique_ptr<PreparedMethod> prepare_dual(TimeOperator& op, const Options& options, std::string& why) {
  auto levels = dual_levels(op, options);
  if (levels->levels.size() == 0) {
    why = levels->refusal;
    return nullptr;
  }
  return std::make_unique<PreparedDual>(op, options, std::move(levels));
}

}  // namespace bromwich
