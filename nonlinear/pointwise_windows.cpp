#include "nonlinear/pointwise_windows.hpp"

#include "core/base/text.hpp"
#include "nonlinear/ncp_batch.hpp"

#include <utility>

namespace bromwich {

PointwiseWindows::PointwiseWindows(const NonlinearScene& scene, const NonlinearSteps& steps, const HostThreads& threads,
                                   const NonlinearOptions& options)
    : scene_(scene), steps_(steps), threads_(threads), options_(options) {}

// y of all time points but the first, which the window before has solved.
bool PointwiseWindows::solve_points(Index from, const Rows& about, RowMatrix& y) {
  const DenseDynamics& d = *scene_.linear.dynamics->small_state();
  const Index count = y.rows() - 1, n = y.cols();
  const Matrix M = to_dense(scene_.linear.M);
  RowMatrix fixed = about.seen.bottomRows(count) * d.N.transpose();
  for (Index k = 0; k < count; ++k) fixed.row(k) += steps_.g(steps_.time(from + 1 + k)).transpose();
  NcpBatch batch;
  batch.problems = count;
  batch.tolerance = options_.tolerance;
  batch.F = [&](Index k, const Eigen::Ref<const Vector>& at, Eigen::Ref<Vector> value) {
    const Vector x = about.seen.row(k + 1);
    value.setZero();
    if (scene_.gamma) scene_.gamma(steps_.time(from + 1 + k), x, at, value);
    value += fixed.row(k).transpose() + M * at;
  };
  batch.F_and_jacobian = [&](Index k, const Eigen::Ref<const Vector>& at, Eigen::Ref<Vector> value, Matrix& J) {
    const Vector x = about.seen.row(k + 1);
    const Linearization gamma = linearize(scene_.gamma, scene_.dgamma, n, steps_.time(from + 1 + k), x, at);
    value = fixed.row(k).transpose() + M * at + gamma.value;
    J = M + gamma.by_y;
  };
  RowMatrix points = y.bottomRows(count);
  const NcpReport report = solve_ncps(batch, options_.concurrent ? threads_ : HostThreads{}, points);
  newton_ += report.newton;
  y.bottomRows(count) = points;
  if (report.first_unsolved < 0) return true;
  reason_ =
      text("the complementarity problem at t = %.6g stayed unsolved", steps_.time(from + 1 + report.first_unsolved));
  return false;
}

RowMatrix PointwiseWindows::states(Index from, const Vector& state, const RowMatrix& about, const RowMatrix& y) const {
  RowMatrix x(y.rows(), state.size());
  x.row(0) = state.transpose();
  const auto source = [&](Index j) { return steps_.total_source(steps_.time(from + j), about.row(j), y.row(j)); };
  Vector left = source(0);
  for (Index j = 1; j < y.rows(); ++j) {
    Vector right = source(j);
    x.row(j) = steps_.carry(from + j, x.row(j - 1).transpose(), left, right).transpose();
    left = std::move(right);
  }
  return x;
}

std::optional<WindowsOfSteps::Outcome> PointwiseWindows::solve(Index from, Index, const Vector& state, Rows& rows) {
  ContractionWatch watch(options_.tolerance);
  for (Index k = 1; k <= options_.most_iterations; ++k) {
    if (options_.interrupted && options_.interrupted()) {
      interrupted_ = true;
      return std::nullopt;
    }
    ++solves_;
    Rows next = rows;
    if (!solve_points(from, rows, next.y)) return std::nullopt;
    next.seen = states(from, state, rows.seen, next.y);
    if (!next.seen.allFinite()) {
      reason_ = "the states are not finite";
      return std::nullopt;
    }
    const double change = apart(next, rows);
    rows = std::move(next);
    switch (watch.after(change)) {
      case ContractionWatch::Verdict::converged:
        end_ = rows.seen.bottomRows(1).transpose();
        return Outcome{watch.contraction(), change};
      case ContractionWatch::Verdict::too_slow:
        reason_ = text("the iteration contracts by %.2g only", watch.last());
        return std::nullopt;
      case ContractionWatch::Verdict::go_on:
        break;
    }
  }
  reason_ = text("the iteration does not end within %ld sweeps", long(options_.most_iterations));
  return std::nullopt;
}

}  // namespace bromwich
