#pragma once
// "temperature > 1.1" as a condition of a memory: two sides that are affine in the states and y.

#include "bromwich/memory.hpp"
#include "files/expression.hpp"

#include <map>
#include <string>
#include <vector>

namespace bromwich {

/// What conditions may name: numbers of x from 0, and those of y behind them.
struct ConditionNames {
  std::map<std::string, std::size_t> variables;  ///< see variables_of (files/state_functions.hpp)
  Index states = 0, constraints = 0;
};

/// The condition, with the times in [0, T] at which its function of time may jump or have a kink. Throws Error(where,
/// ...) for a text that is no comparison, or is not affine.
Memory::Condition read_condition(const std::string& text, const ConditionNames&, const Expressions&, double T,
                                 const std::string& where, SwitchTimes& switches);

}  // namespace bromwich
