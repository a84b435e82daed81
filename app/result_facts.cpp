#include "app/result_facts.hpp"

#include "app/machine.hpp"
#include "app/result_output.hpp"
#include "core/build_info.hpp"
#include "core/result/estimated_quantity.hpp"

#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <random>
#include <sstream>

namespace bromwich::app {

namespace {

std::string contents(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::string compact(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

Json options_to_json(const SolveArguments& arguments, const Options& options) {
  Json json{{"method", arguments.method}, {"backend", arguments.backend}};
  if (options.steps > 0) json["steps"] = options.steps;
  for (const auto& [name, value] : {std::pair("tolerance", options.tolerance),
                                    {"tolerance_x", options.tolerance_x},
                                    {"tolerance_y", options.tolerance_y},
                                    {"absolute_tolerance", options.absolute_tolerance}})
    if (value > 0) json[name] = value;
  json["iteration_tolerance"] = options.iteration_tolerance;
  if (!arguments.threads.empty()) json["threads"] = arguments.threads;
  if (!arguments.at.empty()) json["at"] = arguments.at;
  if (options.event_location) json["event_location"] = true;
  if (!options.confirm) json["confirm"] = false;
  return json;
}

/// FNV-1a.
std::uint64_t digest(const std::string& bytes) {
  std::uint64_t value = 0xcbf29ce484222325;
  for (const char c : bytes) value = (value ^ static_cast<unsigned char>(c)) * 0x100000001b3;
  return value;
}

}  // namespace

Facts facts_of_run(const SolveArguments& arguments, const SceneChoice& choice, const Options& options,
                   const std::string& run) {
  Facts facts{{"format", "bromwich-result/1"},
              {"run", run},
              {"scene", choice.scene.name},
              {"parameters", compact(to_json(choice.parameters))},
              {"options", compact(options_to_json(arguments, options))},
              {"T", choice.scene.T},
              {"command", arguments.command_line},
              {"created", utc_now()},
              {"bromwich_version", build_info::version},
              {"bromwich_commit", build_info::commit}};
  if (!choice.inputs.empty()) facts.emplace_back("scene_file", contents(choice.inputs.front()));
  return facts;
}

Facts facts_of_result(const Result& result, int threads, const Json& summary) {
  Facts facts{{"status", to_string(result.status)},
              {"reason", result.reason},
              {"warning", result.warning},
              {"method", to_string(result.method)},
              {"backend", result.backend},
              {"threads", std::int64_t(threads)},
              {"kernel", result.kernel},
              {"steps", std::int64_t(result.steps)},
              {"iterations", std::int64_t(result.iterations)},
              {"continuous", std::int64_t(result.continuous)},
              {"starts_with_impulse", std::int64_t(result.starts_with_impulse)},
              {"residual", result.residual},
              {"kernel_error", result.kernel_error},
              {"seconds", result.seconds.total},
              {"summary", compact(summary)}};
  for (const auto& [name, value] : {std::pair("error_estimate", result.error_estimate),
                                    {"boundary_residual", result.boundary_residual},
                                    {"infeasible_at", result.infeasible_at}})
    if (value) facts.emplace_back(name, *value);
  if (result.error_estimate) facts.emplace_back("error_estimate_of", estimated_quantity(result));
  if (const Index rows = valid_rows(result); rows > 0) facts.emplace_back("t_end", result.t[rows - 1]);
  return facts;
}

std::string new_run() {
  std::random_device random;
  return fmt::format("{:08x}{:08x}", random(), random());
}

std::string fingerprint(const SceneChoice& choice, const Options& options) {
  std::uint64_t inputs = 0;
  for (const std::filesystem::path& path : choice.inputs) inputs = inputs * 31 + digest(contents(path));
  return fmt::format("{} with {}, T = {}, {} steps of {}, {} states, {} constraints, files {:016x}", choice.scene.name,
                     describe(choice.parameters), choice.scene.T, options.steps, to_string(options.method),
                     choice.scene.states(), choice.scene.constraints(), inputs);
}

}  // namespace bromwich::app
