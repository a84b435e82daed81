#pragma once
// What pages on tables of numbers have in common: the frame of the page, and the cells of a line of CSV.

#include <string>
#include <vector>

namespace bromwich::report {

/// `body` is HTML, the others are text.
std::string plain_page(const std::string& title, const std::string& body, const std::string& version);

/// Cells between commas, which may stand in quotes.
std::vector<std::string> cells_of(const std::string& line);

/// NaN for a cell that is no number.
double number_of(const std::string& cell);

}  // namespace bromwich::report
