#include "nonlinear/adapted_nonlinear.hpp"

#include "core/adapted/tree_control.hpp"
#include "core/certificate/part_sources.hpp"
#include "core/certificate/part_weights.hpp"
#include "core/dynamics/dense.hpp"
#include "nonlinear/divided_step.hpp"
#include "nonlinear/nonlinear_steps.hpp"

#include <algorithm>
#include <map>
#include <utility>

namespace bromwich {

namespace {

constexpr std::size_t most_lengths = 4096;  ///< kept

// The responses to f are those of the parts.
NonlinearScene without_f(NonlinearScene scene) {
  scene.linear.f = {};
  return scene;
}

class AdaptedSteps {
 public:
  AdaptedSteps(const NonlinearScene& scene, Backend& backend, const NonlinearOptions& options)
      : scene_(without_f(scene)),
        T_(scene.linear.T),
        phis_(scene.linear.dynamics->small_state()->A),
        sources_(scene.linear),
        steps_(scene_, backend, 1, StepRule::radau, options.tolerance, options.most_newton) {}

  /// The row at t = 0, and whether y may jump.
  TreeRow start() {
    const Vector zero = Vector::Zero(scene_.linear.constraints());
    TreeRow row{scene_.linear.x0, zero, zero};
    if (selects_least(steps_.lcp_class(row.x, row.y))) steps_.select_least();
    const bool solved = steps_.y_at(0, row.x, row.y).solved;
    y_may_jump_ = !solved || !is_continuous(steps_.lcp_class(row.x, row.y));
    if (y_may_jump_) row.y.setZero();
    return row;
  }
  bool y_may_jump() const { return y_may_jump_; }

  bool take(const Part& part, const TreeRow& from, TreeRow& to) {
    const Length& length = of(part.length);
    const PartSources sources = sources_.on(part);
    const double side = std::min(side_of_break * T_, (part.to - part.from) / 4);
    const Index m = from.x.size(), n = from.y.size();
    StepData step{length.rule, part.from + side, {}, Vector::Zero(2 * m), {sources.g[0], sources.g[1]}};
    for (std::size_t i = 0; i < 2; ++i) {
      const double t = part.from + length.rule.nodes[i] * (part.to - part.from);
      step.times.push_back(std::clamp(t, part.from + side, part.to - side));
      for (std::size_t k = 0; k < 3 && sources_.has_f(); ++k)
        step.increments.segment(Index(i) * m, m) += length.input[i][k] * sources.f[k];
    }
    to.x = from.x;
    to.y = from.y;
    Vector Y;
    const NewtonOutcome outcome = steps_.take(step, to.x, to.y, Y);
    newton_ += outcome.iterations;
    if (!outcome.solved) return false;
    to.integral = from.integral + part.length * (0.75 * Y.head(n) + 0.25 * Y.tail(n));
    return true;
  }
  Index newton() const { return newton_; }

 private:
  struct Length {
    ExponentialStep rule;
    PartInputs input;
  };
  const Length& of(double h) {
    if (lengths_.size() > most_lengths) {
      lengths_.clear();
      phis_ = PhiFamily(scene_.linear.dynamics->small_state()->A);
    }
    const auto [found, added] = lengths_.try_emplace(h);
    if (!added) return found->second;
    found->second.rule = make_exponential_step(scene_.linear.dynamics->small_state()->A, h, StepRule::radau);
    if (sources_.has_f()) found->second.input = part_inputs(phis_, h);
    return found->second;
  }

  const NonlinearScene scene_;
  double T_;
  PhiFamily phis_;
  PartSampler sources_;
  NonlinearSteps steps_;
  std::map<double, Length> lengths_;
  bool y_may_jump_ = false;
  Index newton_ = 0;
};

// w at the rows, before a jump there, and its residual.
void set_slack(const NonlinearScene& scene, const std::vector<double>& breaks, NonlinearResult& r) {
  const Index n = r.y.cols();
  const double side = side_of_break * scene.linear.T;
  r.w = RowMatrix::Zero(r.y.rows(), n);
  for (Index j = 0; j < r.y.rows(); ++j) {
    const auto next = std::lower_bound(breaks.begin(), breaks.end(), r.t[j] - 4 * side);
    const double t = next != breaks.end() && *next <= r.t[j] + 4 * side ? r.t[j] - side : r.t[j];
    const Vector x = r.x.row(j).transpose(), y = r.y.row(j).transpose();
    Vector g = Vector::Zero(n), gamma = Vector::Zero(n);
    if (scene.linear.g) scene.linear.g(t, g);
    if (scene.gamma) scene.gamma(t, x, y, gamma);
    const Vector fixed = observe(scene.linear.dynamics, x) + g + gamma, w = fixed + multiply(scene.linear.M, y);
    r.w.row(j) = w.transpose();
    if (j > 0 && n > 0)
      r.residual =
          std::max(r.residual, w.cwiseMin(y).cwiseAbs().maxCoeff() / std::max(1.0, fixed.cwiseAbs().maxCoeff()));
  }
}

}  // namespace

std::optional<NonlinearResult> march_nonlinear_to_tolerance(const NonlinearScene& scene,
                                                            const std::vector<double>& breaks, Backend& backend,
                                                            const NonlinearOptions& options, const Vector& times) {
  const bool march = options.method == NonlinearMethod::march || options.method == NonlinearMethod::automatic;
  if (!march || !scene.linear.dynamics->small_state() || scene.of_trace) return std::nullopt;
  if (scene.linear.constraints() == 0 || (!scene.phi && !scene.gamma)) return std::nullopt;
  const Index cells = options.steps > 0 ? options.steps : scene.linear.steps();
  AdaptedSteps steps(scene, backend, options);
  const TreeRow start = steps.start();
  TreeMarch tree(
      scene.linear.T, cells, breaks, times.size() > 0 ? times : Vector::LinSpaced(cells + 1, 0, scene.linear.T), true,
      start,
      [&](const Part& p, const TreeRow& from, TreeRow& to) {
        return !(options.interrupted && options.interrupted()) && steps.take(p, from, to);
      },
      std::size_t(options.max_steps));
  TreeGoal goal;
  goal.y = goal.x = options.error;
  goal.y_may_jump = steps.y_may_jump();
  std::optional<TreeSolution> solution = march_to_goal(tree, goal);
  if (!solution) return std::nullopt;
  NonlinearResult r;
  r.status = Status::solved;
  r.method = NonlinearMethod::march;
  r.t = tree.times();
  r.x = std::move(solution->rows.x);
  r.y = std::move(solution->rows.y);
  r.y_integral = std::move(solution->rows.integral);
  r.continuous = false;
  r.own_error = options.error;
  r.error_estimate = std::max(solution->error.of_x(), solution->error_of_y());
  r.newton = steps.newton();
  r.marched = solution->steps;
  set_slack(scene, breaks, r);
  return r;
}

}  // namespace bromwich
