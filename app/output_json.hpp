#pragma once

#include "app/reference_error.hpp"
#include "app/scene_choice.hpp"
#include "core/result/options.hpp"
#include "core/result/result.hpp"

#include <nlohmann/json.hpp>

namespace bromwich::app {

/// JSON whose keys keep the order of insertion.
using Json = nlohmann::ordered_json;

/// The object that `solve --json` prints, schema "bromwich/1". Numbers that are not finite become null.
/// `asked`: what the user asked for, and what the solve decided.
struct Asked {
  const Options& options;
  const std::vector<std::string>& decisions;
};
Json to_json(const SceneChoice& choice, const Result& result, int threads, const ReferenceError& error,
             const Asked& asked);

Json to_json(const ParameterValues& parameters);

/// Indented text; bytes that are not UTF-8 are replaced, so that every result can be printed.
std::string dump(const Json& json);

}  // namespace bromwich::app
