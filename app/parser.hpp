#pragma once
// The commands with their options and help.

#include "app/commands.hpp"

namespace CLI {
class App;
}

namespace bromwich::app {

/// Adds the command with these arguments, which the parser fills. Values stay words: they are converted later, by
/// functions that name the value found and the remedy (app/arguments.hpp).
CLI::App* add_command(CLI::App&, SolveArguments&);
CLI::App* add_command(CLI::App&, CheckArguments&);
CLI::App* add_command(CLI::App&, PlotArguments&);
CLI::App* add_command(CLI::App&, ResponseArguments&);
CLI::App* add_command(CLI::App&, DerivativeArguments&);
CLI::App* add_command(CLI::App&, FitArguments&);
CLI::App* add_command(CLI::App&, BenchArguments&);

}  // namespace bromwich::app
