#include "app/nonlinear_solve.hpp"

#include "app/interaction.hpp"
#include "app/text.hpp"
#include "core/base/error.hpp"
#include "core/base/timer.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/solve/switch_errors.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace bromwich::app {

NonlinearMethod parse_nonlinear_method(const std::string& word) {
  const std::vector<std::string> words{"auto", "march", "iteration", "newton", "pointwise"};
  if (word == words[1]) return NonlinearMethod::march;
  if (word == words[2]) return NonlinearMethod::iteration;
  if (word == words[3]) return NonlinearMethod::newton;
  if (word == words[4]) return NonlinearMethod::pointwise;
  if (word != words[0])
    throw Error("--method", fmt::format("found '{}' for a nonlinear system", word) + suggestion(word, words),
                "use one of " + join(words));
  return NonlinearMethod::automatic;
}

NonlinearOptions nonlinear_options(const SolveArguments& a, const Options& options) {
  for (const auto& [name, given] : {std::pair("--tol-x", !a.tolerance_x.empty()),
                                    {"--tol-y", !a.tolerance_y.empty()},
                                    {"--atol", !a.absolute_tolerance.empty()},
                                    {"--max-seconds", !a.max_seconds.empty()},
                                    {"--event-location", a.event_location},
                                    {"--no-confirm", a.no_confirm},
                                    {"--energies", a.energies},
                                    {"--checkpoint", !a.checkpoint.empty()},
                                    {"--restart", !a.restart.empty()}})
    if (given) throw Error(name, "is given for a nonlinear system", "leave it out");
  NonlinearOptions o;
  o.method = parse_nonlinear_method(a.method);
  o.steps = options.steps;
  o.error = options.tolerance;
  if (!a.max_steps.empty()) o.max_steps = options.max_steps;
  if (!a.iteration_tolerance.empty()) o.tolerance = options.iteration_tolerance;
  o.concurrent = true;  // expressions keep nothing between calls
  o.interrupted = interrupted;
  return o;
}

NonlinearRun::NonlinearRun(const SceneChoice& choice, Backend& backend, const NonlinearOptions& options)
    : choice_(choice), backend_(backend), options_(options) {
  Timer timer;
  result_ = solve_nonlinear(*choice.system, backend, options);
  as_linear_ = as_result(*choice.system, result_);
  as_linear_.backend = backend.name();
  as_linear_.seconds.total = as_linear_.seconds.solve = timer.lap();
}

Result NonlinearRun::at(const std::vector<double>& times) const {
  Result rows = as_result(*choice_.system, nonlinear_at(*choice_.system, backend_, result_, times));
  rows.steps = as_linear_.steps;
  return rows;
}

std::vector<Switch> NonlinearRun::switches() const {
  std::vector<Switch> found = bromwich::switches(as_linear_);
  const Index steps = as_linear_.steps;
  if (found.empty() || result_.status != Status::solved || steps < 2) return found;
  NonlinearOptions half = options_;
  half.error = 0;
  half.confirm = false;
  half.steps = steps / 2;
  const NonlinearResult coarse = solve_nonlinear(*choice_.system, backend_, half);
  const double h = choice_.scene.T / double(steps);
  std::vector<double> apart(found.size(), h);
  if (coarse.status == Status::solved)
    apart = distances(found, bromwich::switches(as_result(*choice_.system, coarse)), h);
  for (std::size_t k = 0; k < found.size(); ++k) found[k].error = std::max(found[k].error, apart[k]);
  return found;
}

Json NonlinearRun::json() const {
  return {{"newton", result_.newton},
          {"linear_solves", result_.solves},
          {"windows", result_.windows},
          {"marched", result_.marched},
          {"contraction", result_.contraction},
          {"defect", result_.defect},
          {"of", choice_.system->of_trace ? "trace" : "state"}};
}

void keep_states(Result& result, const std::vector<Index>& components) {
  if (components.empty()) {
    result.x.resize(result.t.size(), 0);
    result.x_components.clear();
    return;
  }
  if (result.x.cols() == 0)
    throw Error("--states", "found states of a large system with phi and gamma of the trace, which are not recorded",
                "use --states none");
  const RowMatrix all = result.x;
  result.x = all(Eigen::all, components);
  result.x_components = components;
}

std::vector<std::string> nonlinear_facts(const NonlinearScene& given, Index steps) {
  const NonlinearScene scene = in_states(given);
  const Scene& linear = scene.linear;
  const bool dense = linear.dynamics->small_state() && !scene.of_trace;
  const Vector x = scene.of_trace ? observe(linear.dynamics, linear.x0) : linear.x0,
               y = Vector::Zero(linear.constraints());
  std::vector<std::string> lines;
  lines.push_back(fmt::format("{} of {} and y",
                              scene.phi && scene.gamma ? "phi and gamma"
                              : scene.phi              ? "phi"
                                                       : "gamma",
                              given.of_trace ? "v = N x" : "x"));
  constexpr Index most = 1000;  // of a dense derivative
  if (std::max(x.size(), y.size()) <= most) {
    const Linearization phi = linearize(scene.phi, scene.dphi, scene.seen(), 0, x, y);
    const Linearization gamma = linearize(scene.gamma, scene.dgamma, y.size(), 0, x, y);
    if (!phi.value.allFinite() || !gamma.value.allFinite()) lines.push_back("not finite at t = 0 and y = 0");
    const auto size = [](const Matrix& m) { return m.size() > 0 ? m.cwiseAbs().rowwise().sum().maxCoeff() : 0.0; };
    lines.push_back(fmt::format("at t = 0, y = 0: h |dphi| = {:.2g}, |dgamma/dy| = {:.2g}",
                                linear.T / double(steps) * std::max(size(phi.by_x), size(phi.by_y)), size(gamma.by_y)));
    if (dense) {
      const LcpClass c = classify(LcpMatrix(Matrix(to_dense(linear.M) + gamma.by_y)));
      const bool continuous = is_continuous(c);
      lines.push_back(fmt::format(
          "M + dgamma/dy is of class {}: {}", to_string(c),
          continuous ? "y is continuous; methods march, iteration, newton" : "y may jump; method march, by Radau IIA"));
    }
  }
  if (!dense) lines.emplace_back("the linear part is not dense: method iteration");
  return lines;
}

}  // namespace bromwich::app
