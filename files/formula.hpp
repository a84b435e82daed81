#pragma once
// An expression of t, or of t and of variables, as a program for a stack machine. It is used to find the times at which
// an expression of t switches and to differentiate functions of x and y: muParser, which evaluates expressions over
// time, does not give access to their structure.
//
// Names and operators are those of files/expression.hpp. Operands that ?: && || do not select are not evaluated.

#include "catalogue/catalogue.hpp"
#include "files/operation.hpp"

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace bromwich {

struct Instruction {
  Operation operation = Operation::constant;
  double value = 0;        ///< of a constant
  std::size_t target = 0;  ///< of a jump; number of a variable
};

struct Formula {
  std::vector<Instruction> program;
  std::size_t depth = 0;  ///< largest number of values on the stack
  bool switches = false;  ///< it has an operation that jumps or has a kink

  double operator()(double t) const;
};

/// Runs the program of a formula on values of a domain: numbers, or their courses over a piece of time. The domain has
///
///     Value constant(double), Value time(), bool zero(Value), std::optional<Value> apply(Operation, Value a, Value b)
///
/// and, for formulas with variables, Value variable(std::size_t number),
///
/// with any b for an operation on one value. The result is empty where `apply` gave nothing, which ends the run.
/// `stack` is memory that is used again.
template <class Domain, class Value>
std::optional<Value> execute(const Formula& formula, Domain& domain, std::vector<Value>& stack) {
  stack.clear();
  const auto pop = [&stack] {
    const Value top = stack.back();
    stack.pop_back();
    return top;
  };
  for (std::size_t i = 0; i < formula.program.size(); ++i) {
    const Instruction& step = formula.program[i];
    switch (step.operation) {
      case Operation::constant:
        stack.push_back(domain.constant(step.value));
        break;
      case Operation::time:
        stack.push_back(domain.time());
        break;
      case Operation::variable:
        if constexpr (requires { domain.variable(step.target); }) stack.push_back(domain.variable(step.target));
        break;
      case Operation::jump:
        i = step.target - 1;
        break;
      case Operation::jump_if_zero:
        if (domain.zero(pop())) i = step.target - 1;
        break;
      case Operation::jump_if_not_zero:
        if (!domain.zero(pop())) i = step.target - 1;
        break;
      case Operation::truth:
        stack.push_back(domain.constant(double(!domain.zero(pop()))));
        break;
      default: {
        const Value b = takes_two(step.operation) ? pop() : Value{}, a = pop();
        const std::optional<Value> value = domain.apply(step.operation, a, b);
        if (!value) return std::nullopt;
        stack.push_back(*value);
      }
    }
  }
  return stack.back();
}

/// Throws Error(where, ...) for a text that is not an expression, or is nested more than a thousand times. `variables`:
/// names and numbers of what the expression may use besides t.
Formula read_formula(std::string_view text, const ParameterValues& parameters, const std::string& where,
                     const std::map<std::string, std::size_t>& variables = {});

}  // namespace bromwich
