#include "core/march/marching.hpp"

#include "core/base/timer.hpp"
#include "core/kernel/compression.hpp"
#include "core/kernel/weight_check.hpp"
#include "core/march/outcome.hpp"

#include <cmath>
#include <type_traits>

namespace bromwich {

namespace {

struct Plan {
  Recurrence recurrence;
  SampledSource r;  ///< what the recurrence leaves out
  double error = NAN;
  Vector start = {};         ///< dense: what x0 and f_0 add to z_0
  RowMatrix forcing = {};    ///< dense: what f adds to z_j
  Matrix source_input = {};  ///< dense: forcing = p.f source_input^T
};

// The state itself is stepped, x0 and f with it: nothing that grows is computed apart and cancelled later.
Plan dense_plan(const DiscreteProblem& p, Rule rule) {
  const DenseDynamics& d = *p.dense();
  const std::shared_ptr<const StepOperators> operators = state_step(p, rule);
  const StepOperators& step = *operators;
  Plan plan{dense_recurrence(d, step), p.g, NAN, step.decay * p.scene.x0};
  if (p.f.size() == 0) return plan;
  const Matrix F = source_matrix(p), left = step.left * F, right = step.right * F;
  plan.start += left * p.f.row(0);
  plan.source_input = step.decay * right + left;
  plan.forcing = p.f.table() * plan.source_input.transpose();
  plan.r = SampledSource(p.g.table() + p.f.table() * (d.N * right).transpose());
  return plan;
}

// S N (discrete e^{A t_j}) x0 by stepping all modes: for x0 that the driven recurrence cannot carry.
RowMatrix stepped_initial_response(const DiscreteProblem& p, Rule rule) {
  const KroneckerDynamics& d = *p.kronecker();
  const Vector mu = d.along.eigenvalues(), nu = d.across.eigenvalues(), seen = in_sine_basis(d.n);
  RowMatrix x = x0_in_modes(p.backend, d, p.scene.x0, true), decay(x.rows(), x.cols()), modes(p.J + 1, x.rows());
  for (Index l = 0; l < mu.size(); ++l)
    for (Index k = 0; k < nu.size(); ++k) {
      const double z = p.h * (mu[l] + nu[k]);
      decay(l, k) = rule == Rule::exponential ? std::exp(z) : 1 / (1 - z);
    }
  for (Index j = 0; j <= p.J; ++j, x.array() *= decay.array()) modes.row(j) = (x * seen).transpose();
  return modes;
}

// g + S modes, on the host.
RowMatrix with_modes(const DiscreteProblem& p, const RowMatrix& values) {
  const auto modes = p.backend.array(values.rows(), values.cols()), r = p.backend.array(values.rows(), values.cols());
  p.backend.upload(values, *modes);
  upload(p.backend, p.g, *r);
  p.backend.sine_transform(values.cols(), values.rows())->apply(*modes, r.get(), *r, 0);
  RowMatrix sum;
  p.backend.download(*r, sum);
  return sum;
}

Plan modal_plan(const DiscreteProblem& p, Rule rule) {
  const KroneckerDynamics& d = *p.kronecker();
  const Vector b = in_sine_basis(d.b);
  if (b.cwiseAbs().minCoeff() <= 1e-10 * b.cwiseAbs().maxCoeff())
    return {modal_recurrence(d, rule, p.h, RowMatrix()),
            SampledSource(with_modes(p, stepped_initial_response(p, rule)))};
  return {modal_recurrence(d, rule, p.h, x0_in_modes(p.backend, d, p.scene.x0, true)), p.g};
}

Plan compressed_plan(const DiscreteProblem& p, const ExponentialSum& sum) {
  Plan plan{compressed_recurrence(p.backend, *p.kronecker(), sum, p.h), {}, sum.error};
  const auto x0 = kronecker_initial_sum(p, sum);
  if (auto with_x0 = x0 ? started(std::get<ModalRecurrence>(plan.recurrence), x0->coefficients) : std::nullopt) {
    plan.recurrence = std::move(*with_x0);
    plan.error = std::max(plan.error, x0->error);
    plan.r = p.g;
  } else {
    plan.r = SampledSource(with_modes(p, kronecker_initial_response(p)));
  }
  return plan;
}

/// Up to this many eigenvalues a fit, which takes 20 and more exponentials, would not halve their number.
constexpr Index fewest_compressed = 40;

Plan make_plan(const DiscreteProblem& p, Rule rule, RecurrenceChoice choice, std::string& description) {
  if (p.dense()) {
    Plan plan = dense_plan(p, rule);
    description = "state of the scene, stepped";
    if (rule == Rule::implicit_euler) return plan;
    const double m = double(p.scene.states()), n = double(p.scene.constraints());
    const WeightCheck check =
        check_weights(p, std::get<DenseRecurrence>(plan.recurrence), double(p.J) * (m * m + 2 * m * n));
    plan.error = check.error;
    description += " by the matrix exponential" + (check.against.empty() ? "" : ", checked against " + check.against);
    return plan;
  }
  const Index all = p.kronecker()->across.points;
  if (rule == Rule::exponential && choice != RecurrenceChoice::modal &&
      (choice == RecurrenceChoice::compressed || all > fewest_compressed)) {
    const ExponentialSum sum = compress_line_kernel(*p.kronecker(), p.h, p.scene.T);
    const bool fits = sum.error <= accepted_compression_error;
    if (fits && (choice == RecurrenceChoice::compressed || 2 * sum.rates.size() <= all)) {
      description = std::to_string(sum.rates.size()) + " exponentials a mode, stepped";
      return compressed_plan(p, sum);
    }
  }
  description = std::to_string(all) + " eigenvalues a mode, stepped";
  return modal_plan(p, rule);
}

std::size_t bytes_of(const Plan& plan) {
  const Index numbers = std::visit(
      [](const auto& r) {
        if constexpr (std::is_same_v<std::decay_t<decltype(r)>, ModalRecurrence>)
          return 3 * r.decay.size() + r.initial.size();
        else
          return r.decay.size() + 3 * r.input.size();
      },
      plan.recurrence);
  return sizeof(double) * std::size_t(numbers + plan.forcing.size()) + plan.r.bytes();
}

}  // namespace

namespace {

// What stays the same for a march by recurrence and one by lag weights.
class Marching {
 public:
  Marching(const DiscreteProblem& p, const Options& options) : p_(p), wants_trace_(options.trace) {
    problem.M = &p.scene.M;
    problem.lcp_class = p.lcp_class;
    problem.interrupted = options.interrupted;
    if (options.progress) problem.progress = [&options, J = p.J](Index step) { options.progress({step, 0, J}); };
  }

  Array* array(const SampledSource& values) {
    Array* const made = array(values.rows(), values.cols());
    upload(p_.backend, values, *made);
    return made;
  }
  Array* array(const RowMatrix& values) {
    Array* const made = array(values.rows(), values.cols());
    p_.backend.upload(values, *made);
    return made;
  }

  void run(Timer& timer, bool impulse_allowed, Result& result) {
    const Index rows = p_.J + 1, n = p_.scene.constraints();
    const auto y = p_.backend.array(rows, n), v = p_.backend.array(rows, n);
    const auto march = p_.backend.march(problem, rows);
    result.bytes = 2 * y->bytes() + bytes_ + march->bytes() + host_bytes(p_);
    result.seconds.setup += timer.lap();

    const Start start = solve_at_zero(p_, result);
    if (start == Start::none) return;
    if (start == Start::impulse) {
      if (!impulse_allowed) {
        result.status = Status::unsupported;
        result.reason = "x0 violates the constraints and y has to jump; use method march or auto";
        return;
      }
      result.y.row(0).setZero();  // implicit Euler does not look at it
      result.kernel += impulse_note;
    }
    p_.backend.upload(result.y, *y);
    result.seconds.lcp += timer.lap();
    const MarchReport report = march->run(*y, *v);
    p_.backend.download(*y, result.y);
    if (start == Start::impulse) result.y.row(0) = result.y.row(1);
    count(report, result);
    if (wants_trace_) result.trace = trace(p_, *problem.r, *v);
    result.well_posed = report.well_posed;
    if (report.stopped >= 0) return explain_stop(p_, report, result);
    result.residual = march_residual(p_, start, *problem.r, *v, *y);
    result.status = Status::solved;
  }

  MarchProblem problem;

 private:
  Array* array(Index rows, Index cols) {
    arrays_.push_back(p_.backend.array(rows, cols));
    bytes_ += arrays_.back()->bytes();
    return arrays_.back().get();
  }

  const DiscreteProblem& p_;
  bool wants_trace_;
  std::vector<std::unique_ptr<Array>> arrays_;
  std::size_t bytes_ = 0;
};

}  // namespace

void solve_by_marching(const DiscreteProblem& p, Rule rule, const Options& options, Result& result) {
  Timer timer;
  Plan plan = make_plan(p, rule, options.recurrence, result.kernel);
  result.kernel_error = plan.error;
  Marching marching(p, options);
  marching.problem.recurrence = &plan.recurrence;
  Array* const r = marching.array(plan.r);
  p.backend.upload(p.start.transpose(), *r);  // row 0
  add_rough_response(p, *r);
  marching.problem.r = r;
  if (p.kronecker() && p.drive()) marching.problem.drive = marching.array(*p.drive());
  if (plan.forcing.size() > 0) {
    marching.problem.forcing = marching.array(plan.forcing);
    marching.problem.sources = &p.f.table();
    marching.problem.source_input = &plan.source_input;
  }
  if (plan.start.size() > 0) marching.problem.start = &plan.start;
  marching.run(timer, rule == Rule::implicit_euler, result);
  result.bytes += bytes_of(plan);
}

void solve_by_marching(const DiscreteProblem& p, const SparseKernel& kernel, const Options& options, Result& result) {
  Timer timer;
  Marching marching(p, options);
  marching.problem.lags = &kernel.weights;
  marching.problem.r = marching.array(RowMatrix(p.g.table() + kernel.free));
  result.kernel = "lag weights, summed in blocks of time; " + kernel.description;
  result.kernel_error = kernel.error;
  marching.run(timer, false, result);
  result.bytes += kernel.bytes;
}

}  // namespace bromwich
