// Whole solves of signorini on one grid: the CUDA backend, time stepping on the CPU with one core and with all cores,
// and implicit Euler with as many steps as it needs for the error of the iteration.

#include "bench/studies/gpu.hpp"

#include <algorithm>
#include <optional>

namespace bromwich::app {

namespace {

// Runs that take long on the CPU, or are slow on the device, are omitted; values are steps times constraints.
constexpr double most_host_values = 2.2e6;   ///< for time stepping on the CPU
constexpr double most_equal_values = 1.2e7;  ///< for implicit Euler at equal error
constexpr double algebraic_share = 0.05;     ///< of the discretisation error, where cycles end
constexpr Index most_marched = 512;          ///< constraints: above, exchanges of the device's march are slow
constexpr double most_exact_values = 2.2e6;  ///< for the iteration to 1e-12

Options with(Method method, Index J) {
  Options options;
  options.method = method;
  options.steps = J;
  return options;
}

std::vector<GpuContestant> contestants(const Scene& scene, Index J, Backend& cuda, Backend& one, Backend& all) {
  const auto& d = get<KroneckerDynamics>(scene.dynamics);
  Options paper = with(Method::contour, J);
  paper.iteration_tolerance = std::min(scene.T / double(J), d.along.spacing * d.along.spacing) / 50;  // (4.8)
  const Index n = scene.constraints();
  const double values = double(J) * double(n);
  Options cycles = with(Method::multigrid, J);
  cycles.tuning.algebraic_share = algebraic_share;
  std::vector<GpuContestant> list{{"contour to (4.8), cuda", &cuda, paper},
                                  {"contour to (4.8), cuda, again", &cuda, paper},
                                  {"multigrid, cuda", &cuda, cycles},
                                  {"multigrid, cuda, again", &cuda, cycles}};
  for (const std::size_t again : {1, 3}) list[again].kept = std::make_shared<KeptSolver>(cuda);
  if (values <= most_exact_values) list.push_back({"contour, cuda", &cuda, with(Method::contour, J)});
  if (n <= most_marched) list.push_back({"march, cuda", &cuda, with(Method::march, J)});
  if (values > most_host_values) return list;
  if (J <= 400) list.push_back({"contour to (4.8), cpu, all cores", &all, paper});
  list.push_back({"march, cpu, all cores", &all, with(Method::march, J)});
  list.push_back({"march, cpu, one core", &one, with(Method::march, J)});
  list.push_back({"euler, cpu, one core", &one, with(Method::euler, J)});
  return list;
}

Result solve_once(const GpuContestant& c, const Scene& scene) {
  return c.kept ? c.kept->solve(scene, c.options) : solve(scene, *c.backend, c.options);
}

void warm_up(GpuContestant& c, const Scene& scene, const Truth* truth) {
  c.result = solve_once(c, scene);
  if (truth) c.error = truth->of(c.result).y;
  for (RowMatrix* array : {&c.result.y, &c.result.x}) array->resize(0, 0);
}

// The fewest steps, doubled from J, with an error no larger; empty if they would be too many.
std::optional<GpuContestant> euler_at_equal_error(const Scene& scene, Index J, Backend& one, double error,
                                                  const Truth& truth) {
  const Index most_steps = Index(most_equal_values / double(scene.constraints()));
  for (Index steps = 2 * J; steps <= most_steps; steps *= 2) {
    GpuContestant c{"euler, cpu, one core, equal error", &one, with(Method::euler, steps)};
    warm_up(c, scene, &truth);
    if (c.error.max <= error) return c;
    // First order: a doubling at most halves the error, so the distance to the error allows several at once.
    for (double left = c.error.max; left > 2.5 * error && 4 * steps <= most_steps; left /= 2) steps *= 2;
  }
  return std::nullopt;
}

}  // namespace

std::vector<GpuContestant> measure_solves(const Scene& scene, Index J, Backend& cuda, Backend& one, Backend& all,
                                          int repeats, bool quick) {
  std::vector<GpuContestant> list = contestants(scene, J, cuda, one, all);
  // Errors are computed where a reference takes only seconds: on the grid of the paper's examples.
  std::optional<Truth> truth;
  if (J <= 400 && scene.constraints() <= most_marched) truth.emplace(scene, all, J * (quick ? 8 : 16));
  for (GpuContestant& c : list) warm_up(c, scene, truth ? &*truth : nullptr);
  if (truth && !quick)
    if (auto euler = euler_at_equal_error(scene, J, one, list[0].error.max, *truth)) list.push_back(std::move(*euler));
  for (int round = 0; round < repeats; ++round)
    for (GpuContestant& c : list) {
      if (c.result.seconds.total > 1 && round > 0) continue;  // long runs are timed once more only
      const Seconds seconds = solve_once(c, scene).seconds;
      c.samples.add(seconds.total, seconds.setup, seconds.solve);
      c.sweeps.push_back(seconds.sweeps);
    }
  return list;
}

Json solve_row(double Q, const GpuContestant& c) {
  const Result& r = c.result;
  const bool iterates = c.options.method == Method::contour;
  return {{"part", "solve"},
          {"contestant", c.name},
          {"Q", Q},
          {"steps", r.steps},
          {"status", to_string(r.status)},
          {"iterations", iterates ? Json(r.iterations) : Json(nullptr)},
          {"iteration_tolerance", iterates ? Json(c.options.iteration_tolerance) : Json(nullptr)},
          {"seconds", to_json(c.samples)},
          {"repeats", c.samples.total.size()},
          {"sweeps_seconds", iterates ? Json(median(c.sweeps)) : Json(nullptr)},
          {"residual", r.residual},
          {"error_max", c.error.max > 0 ? Json(c.error.max) : Json(nullptr)},
          {"bytes", r.bytes},
          {"bytes_predicted", r.bytes_predicted}};
}

}  // namespace bromwich::app
