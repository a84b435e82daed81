#pragma once
// The table of a sweep: what may be asked of it, and its entries.

#include "app/columns.hpp"
#include "app/commands.hpp"
#include "core/batch/batch.hpp"
#include "core/catalogue/catalogue.hpp"
#include "files/sweep.hpp"

#include <string>
#include <vector>

namespace bromwich::app {

/// Throws Error for options that a sweep does not take, and for files of --out that it cannot write.
void check_sweep_arguments(const SolveArguments&, const ParameterValues& settings, const Sweep&);

std::string csv_number(double value);    ///< of a CSV file
std::string csv_text(std::string text);  ///< likewise, a cell with any characters

/// A column of one scene, a row for each time; `place`: the number of the scene in the result.
Vector values_of(const BatchResult&, const std::vector<Index>& states, const Column&, Index place);

}  // namespace bromwich::app
