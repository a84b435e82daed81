#include "core/iteration/windows.hpp"

#include "core/base/timer.hpp"
#include "core/iteration/functional_iteration.hpp"
#include "core/kernel/operators.hpp"
#include "core/kernel/recurrence.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

namespace bromwich {

namespace {

constexpr Index largest_forecast = 8;             ///< constraints: 2^n active sets give L
constexpr double most_forecast_operations = 3e7;  ///< of the lag weights that the forecast needs
constexpr double safety = 0.1;                    ///< of the tolerance, for amplified rounding

// `count` steps of the problem as a separate problem, from x0 of the scene.
DiscreteProblem window(const DiscreteProblem& p, const Scene& scene, Index count) {
  DiscreteProblem w{scene, p.backend, p.lcp_class, count, p.h, {}, {}, {}, {}};
  w.exponential_step = p.exponential_step;  // of the same length
  w.shared = p.shared;
  return w;
}

// Moves the window to the rows from `first` on.
void move_to(Index first, const DiscreteProblem& p, DiscreteProblem& w) {
  const Index count = w.J, rows = count + 1;
  w.t = p.t.segment(first, rows);
  w.g = p.g.rows(first, rows);
  if (p.f.size() > 0) w.f = p.f.rows(first, rows);
  w.start = p.small_state()->N * w.scene.x0 + w.g.row(0);
  if (!p.defects) return;
  auto defects = std::make_shared<StepDefects>();
  defects->values.resize(0, p.scene.states());
  for (std::size_t i = 0; i < p.defects->steps.size(); ++i) {
    const Index step = p.defects->steps[i] - first;
    if (step < 1 || step > count) continue;
    defects->steps.push_back(step);
    defects->values.conservativeResize(Index(defects->steps.size()), Eigen::NoChange);
    defects->values.bottomRows(1) = p.defects->values.row(Index(i));
  }
  w.defects = std::move(defects);
}

// The iteration on windows of one length: kernel, plans and arrays are made once.
struct WindowIteration {
  WindowIteration(const DiscreteProblem& p, const Scene& scene, Index first, Index count, const Options& options)
      : problem(window(p, scene, count)) {
    move_to(first, p, problem);
    op = make_time_operator(problem);
    prepared = prepare_iteration(*op, options);
  }

  void renew(const DiscreteProblem& p, Index first) {
    move_to(first, p, problem);
    op->renew(Changes{});
    prepared->renew(Changes{});
  }

  DiscreteProblem problem;
  std::unique_ptr<TimeOperator> op;
  std::unique_ptr<PreparedMethod> prepared;
};

void add(const Result& part, Index first, Index count, Result& whole) {
  whole.y.middleRows(first, count + 1) = part.y;
  if (part.trace.size() > 0) whole.trace.middleRows(first, count + 1) = part.trace;
  whole.status = part.status;
  whole.reason = part.reason;
  whole.infeasible_at = part.infeasible_at;
  whole.residual = std::max(whole.residual, part.residual);
  whole.kernel_error = part.kernel_error;
  whole.iterations += part.iterations;
  whole.history.insert(whole.history.end(), part.history.begin(), part.history.end());
  whole.lcp.solved += part.lcp.solved;
  whole.lcp.newton += part.lcp.newton;
  whole.lcp.fallbacks += part.lcp.fallbacks;
  whole.lcp.unsolved += part.lcp.unsolved;
  whole.seconds.setup += part.seconds.setup;
  whole.seconds.lcp += part.seconds.lcp;
  whole.seconds.convolution += part.seconds.convolution;
  whole.bytes = std::max(whole.bytes, part.bytes);
}

}  // namespace

std::optional<Forecast> iteration_forecast(const DiscreteProblem& p, double tolerance) {
  const DenseDynamics* d = p.small_state();
  const double m = double(p.scene.states()), n = double(p.scene.constraints());
  if (!d || p.scene.constraints() > largest_forecast ||
      double(p.J) * (m * m * n + m * n * n) > most_forecast_operations)
    return std::nullopt;
  return forecast(p.scene.M, lag_table(dense_recurrence(*d, *state_step(p, Rule::exponential)), p.J), p.h, tolerance,
                  range_of_M(p));
}

Index iteration_window(const DiscreteProblem& p, double tolerance) {
  const std::optional<Forecast> f = iteration_forecast(p, tolerance);
  // With several solutions, a window could start with a y that does not belong to its initial state.
  if (!f || (!is_continuous(p.lcp_class) && !range_of_M(p).range)) return p.J;
  const double longest = f->longest_window(safety * tolerance);
  return longest > 0 && longest < p.scene.T ? std::max<Index>(1, Index(longest / p.h)) : p.J;
}

void solve_in_windows(const DiscreteProblem& p, Index steps, const Options& options, Result& result) {
  const Index count = (p.J + steps - 1) / steps, length = (p.J + count - 1) / count;
  const auto step = state_step(p, Rule::exponential);
  Scene scene = p.scene;
  result.y = RowMatrix::Constant(p.J + 1, p.scene.constraints(), NAN);
  if (options.trace) result.trace = result.y;
  result.residual = 0;
  std::unique_ptr<WindowIteration> iteration;
  for (Index first = 0; first < p.J; first += length) {
    const Index steps_here = std::min(length, p.J - first);
    Timer setup;
    if (!iteration || iteration->problem.J != steps_here)
      iteration = std::make_unique<WindowIteration>(p, scene, first, steps_here, options);
    else
      iteration->renew(p, first);
    const DiscreteProblem& w = iteration->problem;
    Result part;
    part.seconds.setup += setup.lap();
    iteration->prepared->run(options, part);
    if (part.y.rows() != w.J + 1) part.y = RowMatrix::Constant(w.J + 1, p.scene.constraints(), NAN);
    add(part, first, w.J, result);
    if (first == 0) result.kernel = std::to_string(count) + " windows in time; " + part.kernel;
    if (part.status != Status::solved) return;
    const RowMatrix x = dense_states(*step, scene.x0, state_input(w, part.y), w.defects.get());
    scene.x0 = x.row(w.J).transpose();
  }
}

}  // namespace bromwich
