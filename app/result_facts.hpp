#pragma once
// What files of results say about the run: docs/output.md lists it.

#include "app/commands.hpp"
#include "app/output_json.hpp"
#include "core/result/options.hpp"
#include "files/result_file.hpp"

#include <string>

namespace bromwich::app {

/// Scene, options and provenance, known before the solve.
Facts facts_of_run(const SolveArguments&, const SceneChoice&, const Options&, const std::string& run);

/// Status, reason, warning, errors and how it was solved. `summary`: the object of --json.
Facts facts_of_result(const Result&, int threads, const Json& summary);

/// Sixteen random hexadecimal digits.
std::string new_run();

/// Scene and options that a restart must have in common with the run before it, in words.
std::string fingerprint(const SceneChoice&, const Options&);

}  // namespace bromwich::app
