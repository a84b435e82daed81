#pragma once
// Arguments of the programs of this folder.

#include <CLI/CLI.hpp>

#include <cstdlib>

namespace bromwich {

/// Ends the program after --help, and with a message where arguments are wrong.
inline void parse_or_exit(CLI::App& app, int argc, char** argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    std::exit(app.exit(error));
  }
}

}  // namespace bromwich
