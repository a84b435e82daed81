#pragma once
// An expression of t as a program for a stack machine, used to find the times at which it switches. muParser, which
// evaluates expressions over time, does not give access to their structure.
//
// Names and operators are those of files/expression.hpp. Operands that ?: && || do not select are not evaluated.

#include "core/catalogue/catalogue.hpp"
#include "files/operation.hpp"

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace bromwich {

struct Instruction {
  Operation operation = Operation::constant;
  double value = 0;        ///< of a constant
  std::size_t target = 0;  ///< of a jump
};

struct Formula {
  std::vector<Instruction> program;
  std::size_t depth = 0;  ///< largest number of values on the stack
  bool switches = false;  ///< it has an operation that jumps or has a kink

  double operator()(double t) const;
};

/// Throws Error(where, ...) for a text that is not an expression, or is nested more than a thousand times.
Formula read_formula(std::string_view text, const ParameterValues& parameters, const std::string& where);

}  // namespace bromwich
