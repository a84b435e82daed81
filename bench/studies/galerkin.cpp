// The Galerkin method in time on boundary values and initial values, compared with implicit Euler: the experiments in
// the figures of the paper (Wang and Chen, An exponential integrator based discontinuous Galerkin method for linear
// complementarity systems), and the cost of an application and of a solve.

#include "bench/studies/galerkin.hpp"

#include "app/commands.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <cmath>
#include <functional>

namespace bromwich::app {

namespace {

constexpr Index kink_panels = 6;  ///< of an interval: short panels around kinks between nodes
// Gauss, three points on [0, 1].
const double gauss_node[] = {0.5 - std::sqrt(0.15), 0.5, 0.5 + std::sqrt(0.15)};
constexpr double gauss_weight[] = {5. / 18, 4. / 9, 5. / 18};

using Approximation = std::function<void(Index k, double s, Vector& x, Vector& y)>;

/// `at` gives x and y at t = (k + s) h.
TimeErrors errors_of(const Scene& scene, Index J, const Approximation& at) {
  Vector x(scene.states()), y(scene.constraints()), exact_x(x.size()), exact_y(y.size());
  TimeErrors errors;
  double sum_x = 0, sum_y = 0;
  for (Index k = 0; k < J; ++k)
    for (Index panel = 0; panel < kink_panels; ++panel)
      for (int point = 0; point < 3; ++point) {
        const double s = (double(panel) + gauss_node[point]) / kink_panels;
        at(k, s, x, y);
        scene.exact(scene.T * (double(k) + s) / double(J), exact_x, exact_y);
        sum_x += gauss_weight[point] * (x - exact_x).squaredNorm();
        sum_y += gauss_weight[point] * (y - exact_y).squaredNorm();
      }
  const double weight = scene.T / double(J * kink_panels);
  errors.x_L2 = std::sqrt(weight * sum_x);
  errors.y_L2 = std::sqrt(weight * sum_y);
  at(J - 1, 1, x, y);
  scene.exact(scene.T, exact_x, exact_y);
  errors.x_at_T = (x - exact_x).norm();
  errors.y_at_T = (y - exact_y).norm();
  return errors;
}

void refuse_unused_scene(const BenchRequest& request) {
  if (request.scene)
    throw Error("SCENE", fmt::format("found '{}'", *request.scene),
                "leave it out: this study uses bridge, nash-game, lq-control and periodic-rectifier");
  const bool ratios_alone = request.settings.size() == 1 && request.settings.contains("ratios");
  if ((!request.settings.empty() && !ratios_alone) || request.steps > 0)
    throw Error(request.steps > 0 ? "--steps" : "--set", "this study has sizes of its own",
                "leave it out, or set ratios = 1");
}

}  // namespace

TimeErrors galerkin_errors(const Scene& scene, const RowMatrix& left, const RowMatrix& right, const RowMatrix& x) {
  const Index J = left.rows(), m = scene.states();
  const double h = scene.T / double(J);
  const DenseDynamics d = to_dense(scene.dynamics);
  Vector f = Vector::Zero(m);
  // f may jump at nodes: its slopes are computed just inside.
  const auto slope = [&](Index node, const auto& y, double t) {
    if (scene.f) scene.f(t, f);
    return Vector(h * (d.A * x.row(node).transpose() + d.B * y.transpose() + f));
  };
  Index held = -1;
  Vector from, to;
  return errors_of(scene, J, [&](Index k, double s, Vector& state, Vector& control) {
    if (k != held) {
      from = slope(k, left.row(k), h * (double(k) + 1e-9));
      to = slope(k + 1, right.row(k), h * (double(k) + 1 - 1e-9));
      held = k;
    }
    control = ((1 - s) * left.row(k) + s * right.row(k)).transpose();
    state = ((1 + 2 * s) * (1 - s) * (1 - s) * x.row(k) + s * s * (3 - 2 * s) * x.row(k + 1)).transpose();
    state += s * (1 - s) * (1 - s) * from - s * s * (1 - s) * to;
  });
}

TimeErrors euler_errors(const Scene& scene, const RowMatrix& y, const RowMatrix& x) {
  return errors_of(scene, y.rows(), [&](Index k, double s, Vector& state, Vector& control) {
    control = y.row(k).transpose();
    state = ((1 - s) * x.row(k) + s * x.row(k + 1)).transpose();
  });
}

Json to_json(const TimeErrors& e) {
  return {{"y_L2", e.y_L2}, {"x_L2", e.x_L2}, {"y_at_T", e.y_at_T}, {"x_at_T", e.x_at_T}};
}

BenchReport bench_galerkin(const BenchRequest& request, Backend& backend) {
  refuse_unused_scene(request);
  BenchReport report;
  report.scene = "bridge, nash-game, lq-control, periodic-rectifier";
  report.details["paper"] =
      "Wang and Chen, An exponential integrator based discontinuous Galerkin method for linear complementarity systems";
  report.details["error"] =
      "absolute, Euclidean norm over components: L2 over [0, T] by quadrature, and at T. Galerkin: y linear on each "
      "interval, x continued by cubics; implicit Euler: y constant, x linear on each step";
  report.details["seconds"] = "wall clock of a whole solve, all states included: median of the repeats";
  report.details["euler"] =
      "implicit Euler of all steps at once with the same exchange of active sets and two-point solves as Galerkin "
      "where values are given at both ends, step by step otherwise";
  if (request.settings.contains("ratios")) {  // errors without times
    study_ratios(request, backend, report);
    print_with_notes("", report);
    return report;
  }
  study_convergence(request, backend, report);
  study_spaces(request, backend, report);
  study_galerkin_cost(request, backend, report);
  print_with_notes("", report);
  return report;
}

}  // namespace bromwich::app
