#pragma once
// Shorthands of expressions, replaced by their meaning before an expression is evaluated:
//
//     a name of a definition                               its text
//     pulse(s, period, width)                              1 for width from every multiple of the period on, otherwise
//     0 pulse(s, low, high, delay, rise, fall, width, period)   a periodic pulse as circuit simulators have it pwl(s,
//     t1, v1, t2, v2, ...)                          linear between points; a time given twice is a jump
//
// Values at jumps are those behind them.

#include <functional>
#include <map>
#include <string>
#include <vector>

namespace bromwich {

/// "pulse", "pwl"
std::vector<std::string> shorthand_functions();

/// Texts by name.
using Definitions = std::map<std::string, std::string>;

/// The text without shorthands. `number` evaluates a constant part. Throws Error(where, ...) for wrong arguments, and
/// for a text that would be longer than 200,000 characters.
std::string spelled_out(const std::string& text, const Definitions& definitions,
                        const std::function<double(const std::string&)>& number, const std::string& where);

}  // namespace bromwich
