#include "app/output_json.hpp"

#include "app/goal_arguments.hpp"
#include "app/memory_output.hpp"
#include "app/scene_facts.hpp"
#include "core/result/estimated_quantity.hpp"

#include <cmath>

namespace bromwich::app {

namespace {

Json nullable(const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); }

Json to_json(const Seconds& seconds) {
  return {{"total", seconds.total},
          {"setup", seconds.setup},
          {"solve", seconds.solve},
          {"lcp", seconds.lcp},
          {"convolution", seconds.convolution},
          {"transform", seconds.transform},
          {"other", seconds.other},
          {"certification", seconds.certification}};
}

Json to_json(const LcpCount& count) {
  return {{"solved", count.solved}, {"newton", count.newton}, {"fallbacks", count.fallbacks}};
}

Json errors_to_json(const std::optional<ErrorEstimate>& errors) {
  if (!errors) return nullptr;
  return {{"discretisation", errors->discretisation},
          {"kernel", errors->kernel},
          {"rounding", errors->rounding},
          {"iteration", errors->iteration},
          {"states", errors->states},
          {"order", errors->order},
          {"interior", errors->interior},
          {"tolerance", errors->tolerance},
          {"of", errors->of_integral ? "mean of y" : "y"},
          {"grids", errors->grids},
          {"estimates", errors->estimates}};
}

Json certificate_to_json(const std::optional<Certificate>& c) {
  if (!c) return nullptr;
  return {{"error_of_x", c->error_of_x},
          {"error_of_y", c->error_of_y},
          {"error_of_mean_of_y", c->error_of_mean},
          {"typical_error_of_x", c->typical_error_of_x},
          {"mean_defect", c->mean_defect},
          {"largest_defect", c->largest_defect},
          {"defect_at", c->defect_at},
          {"defect_row", c->defect_row},
          {"impulses", c->impulses}};
}

Json requested_to_json(const Options& o) {
  const auto given = [](double value) { return value > 0 ? Json(value) : Json(nullptr); };
  return {{"method", to_string(o.method)},
          {"steps", o.steps > 0 ? Json(o.steps) : Json(nullptr)},
          {"tolerance", given(o.tolerance)},
          {"tolerance_x", given(o.tolerance_x)},
          {"tolerance_y", given(o.tolerance_y)},
          {"absolute_tolerance", given(o.absolute_tolerance)},
          {"iteration_tolerance", iterates(o.method) ? Json(o.iteration_tolerance) : Json(nullptr)}};
}

/// What the scene file calls its components, and their units; null where it gives none.
Json labels_to_json(const Labels& labels) {
  if (labels.x.empty() && labels.y.empty() && labels.w.empty()) return nullptr;
  return {{"x", labels.x}, {"y", labels.y}, {"w", labels.w}};
}

Json reference_to_json(const std::optional<Reference>& reference) {
  if (!reference) return nullptr;
  return {{"t", nullable(reference->t)},
          {"tolerance", nullable(reference->tolerance)},
          {"status", reference->status},
          {"infeasible_at", nullable(reference->infeasible_at)},
          {"source", reference->source}};
}

}  // namespace

Json to_json(const ParameterValues& parameters) {
  Json json = Json::object();
  for (const auto& [key, value] : parameters) {
    const bool whole = value == std::floor(value) && std::abs(value) < 1e15;
    json[key] = whole ? Json(static_cast<long long>(value)) : Json(value);  // 39 reads better than 39.0
  }
  return json;
}

Json to_json(const SceneChoice& choice, const Result& result, int threads, const ReferenceError& error,
             const Asked& asked) {
  Json json;
  json["schema"] = "bromwich/1";
  json["scene"] = choice.scene.name;
  json["parameters"] = to_json(choice.parameters);
  json["status"] = to_string(result.status);
  json["reason"] = result.reason;
  json["infeasible_at"] = nullable(result.infeasible_at);
  json["sizes"] = {
      {"constraints", choice.scene.constraints()}, {"states", choice.scene.states()}, {"T", choice.scene.T}};
  json["free_rows"] = choice.scene.free_rows;
  json["class"] = matrix_class(choice.scene);
  json["spectrum"] = spectrum_text(choice.scene);
  json["requested"] = requested_to_json(asked.options);
  json["decisions"] = asked.decisions;
  json["method"] = to_string(result.method);
  json["form"] = result.form.empty() ? Json(nullptr) : Json(result.form);
  json["backend"] = result.backend;
  json["threads"] = threads;
  json["kernel"] = result.kernel;
  json["kernel_error"] = result.kernel_error;
  json["steps"] = result.steps;
  json["iterations"] = result.iterations;
  json["cycles"] = result.cycles;
  json["work"] = {{"convolutions", result.convolutions}, {"passes", result.passes}};  // of cycles
  json["history"] = result.history;
  json["continuous"] = result.continuous;
  json["starts_with_impulse"] = result.starts_with_impulse;
  json["residual"] = result.residual;
  json["boundary_residual"] = nullable(result.boundary_residual);
  json["multipliers"] = Json::array();
  for (const Complex& z : result.multipliers) json["multipliers"].push_back({z.real(), z.imag()});
  if (!choice.scene.memories.empty()) json["memories"] = memories_json(choice.scene, result);
  json["warning"] = result.warning;
  json["magnification"] = result.magnification;
  json["algebraic_error"] = nullable(result.algebraic_error);
  json["error_estimate"] = nullable(result.error_estimate);
  json["error_estimate_of"] = result.error_estimate ? Json(estimated_quantity(result)) : Json(nullptr);
  json["errors"] = errors_to_json(result.errors);
  json["certificate"] = certificate_to_json(result.certificate);
  json["reference_error"] = nullptr;
  if (has_reference(choice)) json["reference_error"] = {{"x", nullable(error.x)}, {"y", nullable(error.y)}};
  json["reference"] = reference_to_json(choice.reference);
  json["names"] = labels_to_json(choice.scene.names);
  json["units"] = labels_to_json(choice.scene.units);
  if (!choice.scene.time_unit.empty()) json["units"]["t"] = choice.scene.time_unit;
  json["goal"] = goal_to_json(result);
  json["lcp"] = to_json(result.lcp);
  json["seconds"] = to_json(result.seconds);
  json["bytes"] = result.bytes;
  json["bytes_predicted"] = result.bytes_predicted;
  return json;
}

std::string dump(const Json& json) { return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n"; }

}  // namespace bromwich::app
