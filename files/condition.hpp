#pragma once
// "temperature > 1.1" as a condition of a memory: two sides that are affine in the states and y.

#include "bromwich/memory.hpp"
#include "files/expression.hpp"

#include <map>
#include <string>
#include <vector>

namespace bromwich {

/// What conditions may name: numbers of x from 0, those of y and of memories behind them. A memory stands for the
/// number of its mode.
struct ConditionNames {
  std::map<std::string, std::size_t> variables;
  Index states = 0, constraints = 0, memories = 0;

  /// Of variables_of (files/state_functions.hpp), and memories whose names stand for nothing else.
  ConditionNames(Index states, const std::vector<std::string>& x, Index constraints, const std::vector<std::string>& y,
                 const std::vector<std::string>& memories);
  ConditionNames() = default;
};

/// The condition, with the times in [0, T] at which its function of time may jump or have a kink. Throws Error(where,
/// ...) for a text that is no comparison, or is not affine.
Memory::Condition read_condition(const std::string& text, const ConditionNames&, const Expressions&, double T,
                                 const std::string& where, SwitchTimes& switches);

}  // namespace bromwich
