#include "core/iteration/functional_iteration.hpp"

#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/iteration/sweep_forecast.hpp"
#include "core/kernel/compression.hpp"
#include "core/kernel/kernel.hpp"
#include "core/kernel/ringing.hpp"
#include "core/kernel/weight_check.hpp"
#include "core/lcp/active_set.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

SpaceTimeKernel::SpaceTimeKernel(Backend& backend, std::unique_ptr<Convolution> convolution, bool modal, Index rows,
                                 Index n)
    : backend_(backend), convolution_(std::move(convolution)) {
  if (!modal) return;
  sine_ = backend.sine_transform(n, rows);
  y_modes_ = backend.array(rows, n);
  v_modes_ = backend.array(rows, n);
}

void SpaceTimeKernel::apply(const Array& y, Array& v, Index first) {
  Timer timer;
  if (!sine_) {
    convolution_->apply(y, v, first);
    convolution_seconds += timer.lap();
    return;
  }
  sine_->apply(y, nullptr, *y_modes_, first);
  transform_seconds += timer.lap();
  convolution_->apply(*y_modes_, *v_modes_, first);
  convolution_seconds += timer.lap();
  sine_->apply(*v_modes_, nullptr, v, first);
  transform_seconds += timer.lap();
}

void SpaceTimeKernel::apply_injected(const SpaceTimeKernel& fine, const Array& y_fine, Array& y, Array& v) {
  if (sine_) return apply_injected_modes(fine, v);
  backend_.inject(y_fine, y);
  apply(y, v, 0);
}

void SpaceTimeKernel::apply_injected_modes(const SpaceTimeKernel& fine, Array& v) {
  Timer timer;
  backend_.inject(*fine.y_modes_, *y_modes_);
  convolution_->apply(*y_modes_, *v_modes_, 0);
  convolution_seconds += timer.lap();
  sine_->apply(*v_modes_, nullptr, v, 0);
  transform_seconds += timer.lap();
}

bool SpaceTimeKernel::sweeps(const LcpBatch& lcp) const { return sine_ && lcp.takes_modes(); }

// Between two convolutions the batch takes modes of v and leaves modes of y.
void SpaceTimeKernel::sweep(LcpBatch& lcp, const Array& r, Array& y, Array& v, SweepOrder order) {
  if (order.before) {
    sine_->apply(y, nullptr, *y_modes_, 0);
    convolution_->apply(*y_modes_, *v_modes_, 0);
  }
  bool in_modes = order.before;
  for (int i = 1; i <= order.count; ++i, in_modes = true) {
    const bool more = i < order.count || order.behind;
    lcp.start_in_modes(*sine_, r, in_modes ? *v_modes_ : v, in_modes, y, more ? y_modes_.get() : nullptr, 1);
    if (more) convolution_->apply(*y_modes_, *v_modes_, 0);
  }
  if (order.behind) sine_->apply(*v_modes_, nullptr, v, 0);
}

void SpaceTimeKernel::add_start(const Recurrence& started, const Array& zero, Array& r) {
  backend_.convolution(started, zero.rows())->apply(zero, *v_modes_, 0);
  sine_->apply(*v_modes_, &r, r, 0);
}

std::size_t SpaceTimeKernel::bytes() const {
  return convolution_->bytes() + (sine_ ? sine_->bytes() + y_modes_->bytes() + v_modes_->bytes() : 0);
}

namespace {

constexpr double accepted_kernel_error = 1e-11;  ///< a contour kernel that misses its check by more is not used

/// An iterate may be infeasible for a while (Theorem 3.2 bounds only short horizons); after this many sweeps in which
/// no further row settled it stays so.
constexpr Index most_infeasible_sweeps = 40;

KernelChoice kronecker_kernel(const DiscreteProblem& p, ConvolutionChoice choice) {
  const KroneckerDynamics& d = *p.kronecker();
  const Index rows = p.J + 1, n = d.along.points;
  const auto parameters = contour_parameters(0);
  KernelChoice made;
  if (choice != ConvolutionChoice::fft) {
    const ExponentialSum sum = compress_line_kernel(d, p.h, p.scene.T);
    const bool fits = sum.error <= accepted_compression_error;
    if (fits || choice == ConvolutionChoice::scan) {
      // Where no short sum fits, all eigenvalues are one.
      const Recurrence r = fits ? compressed_recurrence(p.backend, d, sum, p.h)
                                : modal_recurrence(d, Rule::exponential, p.h, RowMatrix());
      made.kernel = std::make_unique<SpaceTimeKernel>(p.backend, p.backend.convolution(r, rows), true, rows, n);
      made.description = fits ? text("scan of %ld exponentials a mode, fitted to contour values (%ld nodes a window)",
                                     long(sum.rates.size()), long(parameters->P + 1))
                              : text("scan of all %ld eigenvalues a mode", long(d.across.points));
      made.error = fits ? sum.error : NAN;
      if (const auto x0 = fits ? kronecker_initial_sum(p, sum) : std::nullopt) {
        made.started = started(std::get<ModalRecurrence>(r), x0->coefficients);
        if (made.started) made.error = std::max(made.error, x0->error);
      }
      return made;
    }
  }
  const LagTable table = contour_lag_table(p.backend, d, *parameters, p.h, p.J);
  made.kernel = std::make_unique<SpaceTimeKernel>(p.backend, p.backend.convolution(table, rows), true, rows, n);
  made.description = text("FFT over lag weights from contours of %ld nodes a window", long(parameters->P + 1));
  made.error = NAN;  // the table is the contour values: nothing else was computed to hold them against
  return made;
}

// Largest deviation of two tables, relative to the largest weight.
double deviation(const LagTable& a, const LagTable& b) {
  const double scale = std::max(a.W.cwiseAbs().maxCoeff(), 1e-300);
  return std::max((a.W - b.W).cwiseAbs().maxCoeff(), (a.S - b.S).cwiseAbs().maxCoeff()) / scale;
}

}  // namespace

// Multiplications of one application: the recurrence against transforms of length 2J.
bool scan_is_cheaper(const DiscreteProblem& p) {
  const double m = double(p.scene.states()), n = double(p.scene.constraints()), J = double(p.J);
  const double scan = J * (m * m + 2 * m * n + n * n), length = 2 * J;
  return scan <= 2 * n * 2.5 * length * std::log2(length) + 2 * n * n * length;
}

namespace {

KernelChoice dense_kernel(const DiscreteProblem& p, ConvolutionChoice choice) {
  const DenseDynamics& d = *p.dense();
  const Index rows = p.J + 1, n = p.scene.constraints();
  const Recurrence recurrence = dense_recurrence(d, *state_step(p, Rule::exponential));
  const Spectrum spectrum = bromwich::spectrum(p.scene.dynamics);
  const auto parameters = contour_parameters(spectrum.half_angle);
  KernelChoice made;
  const bool scan = choice == ConvolutionChoice::scan || (choice == ConvolutionChoice::automatic && scan_is_cheaper(p));
  // The two ways to the weights share nothing, so each checks the other; a scan needs only the first lags for that.
  const Index checked = scan ? std::min<Index>(p.J, 64) : p.J;
  LagTable table = lag_table(recurrence, checked);
  std::string source = "matrix exponential (" + spectrum.describe() + ")";
  made.error = NAN;
  if (!parameters || needs_precision(d.A, p.h, p.J)) {
    const WeightCheck check = check_weights(p, std::get<DenseRecurrence>(recurrence), INFINITY);
    made.error = check.error;
    if (!check.against.empty()) source += ", checked against " + check.against;
  } else {
    LagTable contour = contour_lag_table(p.backend, d, *parameters, p.h, checked);
    made.error = deviation(table, contour);
    if (made.error <= accepted_kernel_error) {
      source = scan ? text("matrix exponential, checked against contours of %ld nodes", long(parameters->P + 1))
                    : text("contours of %ld nodes a window, checked against the matrix exponential",
                           long(parameters->P + 1));
      table = std::move(contour);
    } else {
      // Non-normal A defeats the contour, stiff A costs both some digits: the exponential is used, the gap is reported.
      source = text("matrix exponential, from which contours differ by %.1e", made.error);
    }
  }
  auto convolution = scan ? p.backend.convolution(recurrence, rows) : p.backend.convolution(table, rows);
  made.kernel = std::make_unique<SpaceTimeKernel>(p.backend, std::move(convolution), false, rows, n);
  made.description = (scan ? "scan of the state; " : "FFT over lag weights; ") + source;
  return made;
}

}  // namespace

std::unique_ptr<Array> make_response(const DiscreteProblem& p, KernelChoice& choice, Array& v) {
  const Index rows = p.J + 1, n = p.scene.constraints();
  auto r = p.backend.array(rows, n);
  if (p.dense()) {
    p.backend.upload(dense_response(p, Rule::exponential), *r);
    return r;
  }
  const auto input = p.backend.array(rows, n);
  upload(p.backend, p.g, *r);
  if (choice.started) {
    p.backend.upload(p.start.transpose(), *r);  // row 0: the kernel has nothing at t = 0
    choice.kernel->add_start(*choice.started, *input, *r);
  } else {
    p.backend.upload(kronecker_initial_response(p), *input);
    p.backend.sine_transform(n, rows)->apply(*input, r.get(), *r, 0);  // g + S N e^{At} x0
  }
  add_rough_response(p, *r);
  if (!p.drive()) return r;
  upload(p.backend, *p.drive(), *input);
  choice.kernel->apply(*input, v, 0);
  p.backend.add(*r, 1, v, *r);
  return r;
}

KernelChoice make_kernel(const DiscreteProblem& p, ConvolutionChoice choice) {
  return p.kronecker() ? kronecker_kernel(p, choice) : dense_kernel(p, choice);
}

namespace {

// Watches the sweeps and says when they are over.
class Watch {
 public:
  explicit Watch(double tolerance) : tolerance_(tolerance) {}

  // Sweeps in which nothing settled and changes did not fall.
  Index stuck() const { return stuck_; }

  // The outcome once it is known. `advanced`: rows have settled since the last sweep.
  std::optional<IterationOutcome> after(const DiscreteProblem& p, const LcpReport& report, bool advanced) {
    if (!report.finite || !(report.magnitude < 1e100))
      return IterationOutcome{Status::nonfinite, "the iterates grew beyond all bounds", -1};
    infeasible_for_ = report.infeasible >= 0 && !advanced ? infeasible_for_ + 1 : 0;
    // Rounding keeps a converged iteration moving at a level of its own; a 2-cycle does so at any level.
    stuck_ = advanced || report.change < 0.99 * best_ ? 0 : stuck_ + 1;
    best_ = std::min(best_, report.change);
    if (report.change <= tolerance_ || (stuck_ >= 12 && report.change <= rounding_level)) return converged(report);
    if (infeasible_for_ >= most_infeasible_sweeps)
      return IterationOutcome{Status::tolerance_not_met,
                              text("the iterate is infeasible from t = %.6g on", p.t[report.infeasible]),
                              report.infeasible};
    if (stuck_ >= 200)
      return IterationOutcome{
          Status::tolerance_not_met,
          text("the iteration does not contract: change %.2e in the last sweep; use method march", report.change), -1};
    return std::nullopt;
  }

 private:
  static constexpr double rounding_level = 1e-10;

  static IterationOutcome converged(const LcpReport& report) {
    if (report.count.unsolved == 0) return {Status::solved, "", -1};
    return {Status::tolerance_not_met, text("%ld complementarity problems stayed unsolved", report.count.unsolved),
            report.infeasible};
  }

  double tolerance_, best_ = INFINITY;
  Index stuck_ = 0, infeasible_for_ = 0;
};

void count(const LcpReport& report, double seconds, Result& result) {
  result.seconds.lcp += seconds;
  result.lcp.solved += report.count.solved;
  result.lcp.newton += report.count.newton;
  result.lcp.fallbacks += report.count.fallbacks;
  result.lcp.unsolved = report.count.unsolved;
  ++result.iterations;
}

// Other grids (half the step, windows in time) are solved with the same options: they start from x0.
void start_from_given(const DiscreteProblem& p, const Options& options, Array& y) {
  const RowMatrix* given = options.first_iterate;
  if (!given || given->rows() != p.J + 1 || p.lcp_class == LcpClass::Z) return;
  RowMatrix start;
  p.backend.download(y, start);
  start.bottomRows(p.J) = given->bottomRows(p.J);  // y_0 is the solution of its problem already
  p.backend.upload(start, y);
}

// Whether an iteration that has run for some sweeps will come to an end, by what was seen of it.
class Outlook {
 public:
  Outlook(const DiscreteProblem& p, const Options& options)
      : p_(p), forecast_(p.J, options.iteration_tolerance, options.max_iterations) {}

  std::optional<IterationOutcome> after(const LcpReport& report, Index stuck, const Array& y) {
    forecast_.add(report.settled, report.change);
    if (const auto why = forecast_.hopeless()) return IterationOutcome{Status::tolerance_not_met, *why, -1};
    if (stuck < stuck_for_some_time) {
      at_ = y.rows();
      last_.resize(0, 0);
      return std::nullopt;
    }
    RowMatrix values;
    p_.backend.download(y, values);
    at_ = std::min(at_, first_moving(values));  // in a cycle a row may rest in some sweeps
    last_ = values;
    if (at_ >= y.rows()) return std::nullopt;
    const auto contracts = front_.contracts(at_, values.row(at_).transpose());
    if (!contracts || *contracts) return std::nullopt;
    return IterationOutcome{Status::tolerance_not_met,
                            text("the sweeps do not contract at t = %.6g, where a change comes back %.2g times as "
                                 "large: M does not outweigh the first lag there; use method march or more steps",
                                 p_.t[at_], front_.factor()),
                            -1};
  }

 private:
  static constexpr Index stuck_for_some_time = 24;

  // The first row that the last sweep has changed by more than rounding: rows before it may never settle to the last
  // digit.
  Index first_moving(const RowMatrix& y) const {
    constexpr double rounding = 1e-10;
    Index j = 0;
    while (j < last_.rows() &&
           (y.row(j) - last_.row(j)).cwiseAbs().maxCoeff() <= rounding * std::max(1.0, y.row(j).cwiseAbs().maxCoeff()))
      ++j;
    return last_.rows() > 0 ? j : y.rows();
  }

  const DiscreteProblem& p_;
  SweepForecast forecast_;
  FrontRow front_;
  Index at_ = 0;  ///< the row at the front
  RowMatrix last_;
};

}  // namespace

IterationOutcome iterate(const DiscreteProblem& p, const Options& options, const ApplyKernel& apply, bool recordable,
                         LcpBatch& lcp, const Array& r, Array& y, Array& v, Result& result) {
  const double settle = std::max(0.01 * options.iteration_tolerance, 32 * epsilon);
  Timer timer;
  {  // x^0(t) = x0 (Theorem 3.2): q_j = N x0 + g_j
    const auto q = p.backend.array(p.J + 1, p.scene.constraints());
    upload(p.backend, p.g.plus(p.start - p.g.row(0)), *q);
    timer.lap();
    const LcpReport report = lcp.solve(*q, v, y, 0, -1);
    count(report, timer.lap(), result);
    // q_0 does not change any more: what is infeasible there is proven.
    if (report.infeasible == 0) return {Status::infeasible, "no solution at t = 0", 0, 0};
    start_from_given(p, options, y);
    timer.lap();
  }
  Timer sweeps;
  // Short sweeps are recorded once; they then do all rows, since leaving out what has settled would save nothing.
  std::unique_ptr<Program> sweep;
  if (recordable)
    sweep = p.backend.record(y.rows() * y.cols(), [&] {
      apply(y, v, 0);
      lcp.start(r, v, y, 0, settle);
    });
  Watch watch(options.iteration_tolerance);
  Outlook outlook(p, options);
  Index first = 0;        // rows before it have settled
  Index solved_from = 0;  // rows before it were left alone by the last batch
  Index furthest = 0;     // that `first` has been; recorded sweeps may fall back
  const auto ended = [&](IterationOutcome outcome) {
    outcome.settled = first;
    result.seconds.sweeps = sweeps.lap();
    return outcome;
  };
  while (result.iterations < options.max_iterations) {
    if (options.interrupted && options.interrupted()) return ended({Status::interrupted, "stopped on request", -1});
    LcpReport report;
    if (sweep) {
      sweep->run();
      timer.lap();
      report = lcp.finish(r, v, y, 0, settle);
    } else {
      apply(y, v, solved_from);
      timer.lap();
      report = lcp.solve(r, v, y, first, settle);
    }
    count(report, timer.lap(), result);
    result.history.push_back(report.change);
    if (options.progress) options.progress({result.iterations, report.change});
    const bool advanced = report.settled > furthest;
    furthest = std::max(furthest, report.settled);
    solved_from = first;
    first = report.settled;
    if (auto outcome = watch.after(p, report, advanced)) return ended(*outcome);
    if (auto outcome = outlook.after(report, watch.stuck(), y)) return ended(*outcome);
  }
  const double last = result.history.empty() ? NAN : result.history.back();
  return ended({Status::tolerance_not_met,
                text("change %.2e after %ld iterations, the limit", last, long(result.iterations)), -1});
}

void finish_iteration(const DiscreteProblem& p, const Options& options, const IterationOutcome& outcome,
                      const ApplyKernel& apply, LcpBatch& lcp, const Array& r, const Array& y, Array& v,
                      Result& result) {
  result.status = outcome.status;
  result.reason = outcome.reason;
  result.well_posed = p.lcp_class != LcpClass::unknown;
  if (outcome.infeasible >= 0) result.infeasible_at = p.t[outcome.infeasible];
  p.backend.download_during(y, result.y, [&] {
    if (outcome.status == Status::infeasible) return;
    result.alternates = p.backend.alternates(y, ringing_run, ringing_part);
    apply(y, v, 0);
    result.residual = lcp.residual(r, v, y);
  });
  if (outcome.status == Status::infeasible) return;
  if (options.trace) result.trace = trace(p, r, v);
  // What had not settled when the iteration was cut off is no solution.
  if (outcome.status == Status::interrupted || outcome.status == Status::nonfinite)
    result.y.bottomRows(result.y.rows() - outcome.settled).setConstant(NAN);
}

namespace {

// Iterates with a kernel and a response that are ready, and accounts for it.
void iterate_with(const DiscreteProblem& p, KernelChoice& choice, const Array& r, Timer& setup, const Options& options,
                  Result& result) {
  const Index rows = p.J + 1, n = p.scene.constraints();
  const auto y = p.backend.array(rows, n), v = p.backend.array(rows, n);
  const auto lcp = p.backend.lcp(p.scene.M, p.lcp_class, rows);
  result.kernel = choice.description;
  result.kernel_error = choice.error;
  result.bytes += y->bytes() + v->bytes() + r.bytes() + choice.kernel->bytes() + lcp->bytes() + host_bytes(p);
  choice.kernel->transform_seconds = choice.kernel->convolution_seconds = 0;
  result.seconds.setup += setup.lap();

  const ApplyKernel apply = [&](const Array& in, Array& out, Index first) { choice.kernel->apply(in, out, first); };
  const IterationOutcome outcome = iterate(p, options, apply, true, *lcp, r, *y, *v, result);
  finish_iteration(p, options, outcome, apply, *lcp, r, *y, *v, result);
  result.seconds.transform = choice.kernel->transform_seconds;
  result.seconds.convolution = choice.kernel->convolution_seconds;
}

}  // namespace

void solve_by_iteration(const DiscreteProblem& p, const Options& options, Result& result) {
  Timer setup;
  KernelChoice choice = make_kernel(p, options.convolution);
  const auto workspace = p.backend.array(p.J + 1, p.scene.constraints());
  const auto r = make_response(p, choice, *workspace);
  iterate_with(p, choice, *r, setup, options, result);
}

void solve_by_iteration(const DiscreteProblem& p, const SparseKernel& kernel, const Options& options, Result& result) {
  Timer setup;
  const Index rows = p.J + 1, n = p.scene.constraints();
  KernelChoice choice{
      std::make_unique<SpaceTimeKernel>(p.backend, p.backend.convolution(kernel.weights, rows), false, rows, n),
      "FFT over lag weights; " + kernel.description, kernel.error};
  const auto r = p.backend.array(rows, n);
  p.backend.upload(p.g.table() + kernel.free, *r);
  result.bytes = kernel.bytes;
  iterate_with(p, choice, *r, setup, options, result);
}

}  // namespace bromwich
