#pragma once
// A page on frequency responses: size and phase of all of them over frequency (Bode's diagram).

#include "core/base/types.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace bromwich::report {

struct ResponseCurves {
  std::vector<std::string> names, units;                        ///< units may be empty
  Vector frequencies;                                           ///< Hz
  RowMatrix sizes, phases;                                      ///< frequencies x names; degrees
  std::vector<std::pair<std::string, std::string>> facts = {};  ///< rows of a table above the pictures
};

/// "frequency", then "abs(NAME)" and "phase(NAME)" of each, one row a frequency.
std::string response_table(const ResponseCurves&);

/// What response_table has written; nothing for another file. Throws Error(argument, ...) where it is damaged.
std::optional<ResponseCurves> read_response_table(const std::string& argument, const std::filesystem::path&);

std::string response_page(const ResponseCurves&, const std::string& name, const std::string& version);

}  // namespace bromwich::report
