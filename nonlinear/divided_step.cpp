#include "nonlinear/divided_step.hpp"

#include "core/scene/breakpoints.hpp"

#include <algorithm>
#include <utility>

namespace bromwich {

namespace {

// Sources and functions on [a, b] alone, with the clock set back to 0.
NonlinearScene part(const NonlinearScene& scene, double a, double b, const Vector& x) {
  const double side = std::min(side_of_break * scene.linear.T, (b - a) / 4);
  const auto time = [a, low = a + side, high = b - side](double s) { return std::clamp(a + s, low, high); };
  NonlinearScene one = scene;
  one.linear = part_of(scene.linear, 0, b - a, x);
  for (auto source : {&Scene::f, &Scene::g})
    if (scene.linear.*source)
      one.linear.*source = [given = scene.linear.*source, time](double s, Eigen::Ref<Vector> v) { given(time(s), v); };
  one.linear.breakpoints.clear();
  one.linear.breakpoints_are_all = true;
  one.linear.exact = {};
  const auto values = [time](NonlinearFunction& function) {
    if (function)
      function = [of = function, time](double s, const auto& seen, const auto& y, Eigen::Ref<Vector> v) {
        of(time(s), seen, y, v);
      };
  };
  const auto derivatives = [time](NonlinearDerivative& derivative) {
    if (derivative)
      derivative = [of = derivative, time](double s, const auto& seen, const auto& y, Eigen::Ref<Matrix> by_seen,
                                           Eigen::Ref<Matrix> by_y) { of(time(s), seen, y, by_seen, by_y); };
  };
  values(one.phi);
  values(one.gamma);
  derivatives(one.dphi);
  derivatives(one.dgamma);
  return one;
}

}  // namespace

std::vector<double> divisions_of(const Scene& scene) {
  constexpr double visible = 1e-6;  // of the values; smooth sources change by 1e-12 of them over the distance
  std::vector<double> breaks;
  const double side = side_of_break * scene.T;
  for (const double b : scene.breakpoints_are_all ? scene.breakpoints : find_breakpoints(scene)) {
    if (b <= side || b >= scene.T - side) continue;
    bool taken = std::binary_search(scene.breakpoints.begin(), scene.breakpoints.end(), b);
    for (const auto& [source, size] : {std::pair(&scene.f, scene.sources()), {&scene.g, scene.constraints()}}) {
      if (taken || !*source) continue;
      Vector before = Vector::Zero(size), behind = before;
      (*source)(b - side, before);
      (*source)(b + side, behind);
      const double most = std::max(before.cwiseAbs().maxCoeff(), behind.cwiseAbs().maxCoeff());
      taken = (behind - before).cwiseAbs().maxCoeff() > visible * most;
    }
    if (taken) breaks.push_back(b);
  }
  return breaks;
}

NewtonOutcome take_divided(const NonlinearScene& scene, Backend& backend, const StepOptions& options, double t,
                           double length, const std::vector<double>& breaks, Vector& x, Vector& y) {
  const double near = 4 * side_of_break * scene.linear.T;
  std::vector<double> ends;
  for (const double b : breaks)
    if (b > t + near && b < t + length - near) ends.push_back(b);
  ends.push_back(t + length);
  NewtonOutcome all;
  double from = t;
  for (const double to : ends) {
    const NonlinearScene one = part(scene, from, to, x);
    NonlinearSteps steps(one, backend, 1, options.rule, options.tolerance, options.most_newton);
    steps.set_sizes(options.sizes);
    if (options.least) steps.select_least();
    if (options.rule == StepRule::linear && from > t) {
      const NewtonOutcome begin = steps.y_at(0, x, y);
      all.iterations += begin.iterations;
      if (!begin.solved) return {false, all.iterations, begin.change, begin.why, begin.nonfinite};
    }
    const NewtonOutcome outcome = steps.take(1, x, y);
    all = {outcome.solved, all.iterations + outcome.iterations, outcome.change, outcome.why, outcome.nonfinite};
    if (!all.solved) return all;
    from = to;
  }
  return all;
}

}  // namespace bromwich
