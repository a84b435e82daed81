#pragma once

#include "app/commands.hpp"
#include "catalogue/catalogue.hpp"

#include <optional>
#include <string>

namespace bromwich::app {

/// `bromwich solve` of a netlist with .step cards: its exit code; nothing for other scenes, and where `settings` fix
/// all that they step.
std::optional<int> run_map(const SolveArguments&, const std::string& scene, const ParameterValues& settings);

}  // namespace bromwich::app
