#pragma once
// The parser of muParser with the functions of expressions.

#include "catalogue/catalogue.hpp"

#include <muParser.h>

#include <cstddef>
#include <string>
#include <vector>

namespace bromwich {

/// Longer texts are rejected by muParser: they are evaluated as a Formula.
inline constexpr std::size_t longest_parsed = 19'000;
inline bool parsed(const std::string& text) { return text.size() <= longest_parsed; }

/// A parser with pi, the parameters as constants and only the functions of expressions, without muParser's own.
mu::Parser make_parser(const ParameterValues& parameters);

/// "sin", "cos", ...
std::vector<std::string> parser_functions();

}  // namespace bromwich
