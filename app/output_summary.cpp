#include "app/output_summary.hpp"

#include "app/memory_output.hpp"
#include "app/scene_facts.hpp"
#include "app/text.hpp"
#include "core/goal/goal.hpp"
#include "core/result/estimated_quantity.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <iterator>

namespace bromwich::app {

namespace {

std::string scene_line(const SceneChoice& choice) {
  const std::string parameters = describe(choice.parameters);
  return parameters.empty() ? choice.scene.name : fmt::format("{} ({})", choice.scene.name, parameters);
}

std::string grid_line(const Scene& scene, const Result& result) {
  const Index steps = result.steps;
  const auto counted = [](Index number, const char* noun) {
    return fmt::format("{} {}{}", number, noun, number == 1 ? "" : "s");
  };
  std::string line = counted(scene.constraints(), "constraint") + ", " + counted(scene.states(), "state");
  if (result.goal && steps > 0) {
    const Vector h = result.t.tail(steps) - result.t.head(steps);
    return line +
           fmt::format(", {} steps of {:.3g} to {:.3g} up to T = {:.6g}", steps, h.minCoeff(), h.maxCoeff(), scene.T);
  }
  if (steps > 0) line += fmt::format(", {} steps of {:.6g} up to T = {:.6g}", steps, scene.T / double(steps), scene.T);
  if (!scene.time_unit.empty()) line += " " + one_line(scene.time_unit);
  return line;
}

std::string error_line(const Result& result) {
  if (std::isnan(result.residual)) return "not known: nothing was solved";
  const std::string kernel = std::isnan(result.kernel_error) ? "kernel weights not cross-checked"
                                                             : fmt::format("{:.1e} of the kernel", result.kernel_error);
  const std::string boundary =
      result.boundary_residual ? fmt::format(", {:.1e} of the boundary condition", *result.boundary_residual) : "";
  // With a tolerance the line below has the estimate of all components.
  const std::string discretisation =
      result.errors && !std::isnan(result.errors->discretisation)
          ? fmt::format(", discretisation {:.2e}", result.errors->discretisation)
      : result.errors && result.error_estimate ? ""
      : result.error_estimate
          ? fmt::format(", discretisation about {:.1e} of {}", *result.error_estimate, estimated_quantity(result))
          : ", discretisation not estimated (--tol)";
  return fmt::format("{:.2e} of the complementarity{}, {}{}", result.residual, boundary, kernel, discretisation);
}

std::string estimate_line(const Result& result) {
  const ErrorEstimate& errors = *result.errors;
  const std::string found = result.error_estimate
                                ? fmt::format("about {:.1e} of {}", *result.error_estimate, estimated_quantity(result))
                                : "not estimated";
  const std::string order = std::isnan(errors.order) ? "" : fmt::format(", order {:.1f} observed", errors.order);
  return fmt::format("{} (tolerance {:g}){}, grids {}", found, errors.tolerance, order, fmt::join(errors.grids, " "));
}

std::string goal_line(const GoalReport& goal) {
  const GoalCycle &first = goal.history.front(), &last = goal.history.back();
  return fmt::format("{} {:.3e} with {} steps, {:.3e} with {}; error about {:.1e}{}", goal.quantity, first.quantity,
                     first.cells, last.quantity, last.cells, std::abs(last.estimate),
                     last.effectivity ? fmt::format(", {:.2f} of the true one", *last.effectivity) : "");
}

std::string energy_line(const EnergyBalance& b) {
  if (b.energy.size() == 0) return "-";
  return fmt::format("{:.6g} at 0, {:.6g} at T, supplied {:.6g}, dissipated {:.6g}, violation {:.2e}", b.energy[0],
                     b.energy[b.energy.size() - 1], b.supplied.sum(), b.dissipated.sum(), b.violation.cwiseAbs().sum());
}

std::string time_line(const Seconds& s) {
  return fmt::format("{} = setup {} + solve {}", format_seconds(s.total), format_seconds(s.setup),
                     format_seconds(s.solve));
}

std::string split_line(const Seconds& s) {
  return fmt::format("lcp {}, convolution {}, transform {}, other {}", format_seconds(s.lcp),
                     format_seconds(s.convolution), format_seconds(s.transform), format_seconds(s.other));
}

/// The range of y in the last row.
std::string last_line(const Result& result) {
  if (result.y.size() == 0) return "not reached";
  const auto last = result.y.row(result.y.rows() - 1);
  if (!last.allFinite()) return "not reached";
  return fmt::format("between {:.10g} and {:.10g}", last.minCoeff(), last.maxCoeff());
}

std::string reference_line(const SceneChoice& choice, const ReferenceError& error) {
  const auto difference = [](const std::optional<double>& value, const char* name) {
    return value ? fmt::format("{:.2e} of {}", *value, name) : fmt::format("{} not compared", name);
  };
  std::string line = fmt::format("error {}, {}", difference(error.x, "x"), difference(error.y, "y"));
  if (!choice.reference) return line;
  const Reference& reference = *choice.reference;
  if (reference.tolerance) line += fmt::format("; expected at most {:.2g}", *reference.tolerance);
  if (reference.status != to_string(Status::solved)) line += "; expected to end as " + reference.status;
  if (reference.infeasible_at) line += fmt::format(" from t = {:.10g}", *reference.infeasible_at);
  return line;
}

}  // namespace

std::string summary(const SceneChoice& choice, const Result& result, int threads, const ReferenceError& error,
                    const std::string& out, const std::string& method) {
  std::string text;
  const auto line = [&text](const char* label, const std::string& value) {
    fmt::format_to(std::back_inserter(text), "{:<11} {}\n", label, value);
  };
  line("scene", scene_line(choice));
  line("size", grid_line(choice.scene, result));
  line("class", fmt::format("{}; spectrum {}", matrix_class(choice.scene), spectrum_text(choice.scene)));
  line("method", fmt::format("{} on {}, {} thread{}", method.empty() ? to_string(result.method) : method,
                             result.backend, threads, threads == 1 ? "" : "s"));
  line("kernel", result.kernel.empty() ? "-" : result.kernel);
  line("status", to_string(result.status));
  if (!result.warning.empty()) line("warning", one_line(result.warning));
  if (result.infeasible_at) line("infeasible", fmt::format("from t = {:.10g}", *result.infeasible_at));
  line("iterations", fmt::format("{}{}; {} problems solved, {} Newton sweeps, {} fallbacks", result.iterations,
                                 result.cycles > 0 ? fmt::format(" in {} cycles", result.cycles) : "",
                                 result.lcp.solved, result.lcp.newton, result.lcp.fallbacks));
  line("errors", error_line(result));
  if (result.errors) line("error", estimate_line(result));
  if (has_reference(choice)) line("reference", reference_line(choice, error));
  if (result.goal) {
    line("quantity", goal_line(*result.goal));
    line("energy", energy_line(result.goal->balance));
  }
  if (!choice.scene.memories.empty()) line("modes", memory_line(choice.scene, result));
  if (choice.scene.constraints() > 0) line("y at T", last_line(result));
  line("time", time_line(result.seconds));
  line("  of solve", split_line(result.seconds));
  const bool predicted = result.bytes_predicted > 0;  // some methods predict nothing
  line("memory", format_bytes(double(result.bytes)) +
                     (predicted ? ", predicted " + format_bytes(double(result.bytes_predicted)) : ""));
  line("output", out.empty() ? "none; --out FILE.csv writes y, --json prints this for programs" : out);
  return text;
}

}  // namespace bromwich::app
