#pragma once
// `bromwich solve FILE.toml` where the file has a section [sweep]: many scenes, one table.

#include "app/commands.hpp"
#include "catalogue/catalogue.hpp"

#include <optional>
#include <string>

namespace bromwich::app {

/// Solves the scenes of [sweep]; empty if the scene has no such section.
std::optional<int> run_sweep(const SolveArguments&, const std::string& scene, const ParameterValues& settings);

}  // namespace bromwich::app
