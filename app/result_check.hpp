#pragma once
// What a file of results says of the run, and what its rows say of themselves.

#include "report/result_table.hpp"

#include <string>

namespace bromwich::app {

/// Whether the name is that of a file of results, by its extension.
bool names_result(const std::string& name);

struct ResultCheck {
  std::string text;
  bool solved = false;  ///< the file says so, or says nothing and y and w are complementary
};

ResultCheck check_result(const std::string& name, const report::ResultTable&);

}  // namespace bromwich::app
