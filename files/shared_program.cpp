#include "files/shared_program.hpp"

#include <utility>
#include <vector>

namespace bromwich {

namespace {

constexpr std::size_t of_time = ~std::size_t(0);  ///< number of t among the variables

/// What the optimiser sees of an operand.
struct Seen {
  enum Kind { value, variable, product, line, other } kind = other;  ///< product: c v; line: c v + c'
  std::size_t of = 0;                                                ///< the variable

  bool follows() const { return kind == variable || kind == product || kind == line; }
};

/// What it makes of an operation, and whether that has the bits of the operation itself.
struct Made {
  Seen seen;
  bool exact = true;
};

Made of_sum(const Seen& a, const Seen& b) {
  if (a.follows() && b.follows() && a.of == b.of) return {{Seen::line, a.of}, false};
  const Seen& left = a.follows() ? a : b;
  if (!left.follows() || (a.kind != Seen::value && b.kind != Seen::value)) return {};
  return {{Seen::line, left.of}, left.kind != Seen::line};
}

Made of_product(const Seen& a, const Seen& b) {
  const Seen& left = a.follows() ? a : b;
  if (!left.follows() || (a.kind != Seen::value && b.kind != Seen::value)) return {};
  if (left.kind == Seen::variable) return {{Seen::product, left.of}, true};
  return {left, false};
}

Made of_two(Operation o, const Seen& a, const Seen& b) {
  if (a.kind == Seen::value && b.kind == Seen::value) return {{Seen::value}, true};
  switch (o) {
    case Operation::add:
    case Operation::subtract:
      return of_sum(a, b);
    case Operation::multiply:
      return of_product(a, b);
    case Operation::divide:
      if ((a.kind == Seen::product || a.kind == Seen::line) && b.kind == Seen::value) return {a, false};
      return {};
    case Operation::power:
      return {{}, a.kind != Seen::variable || b.kind != Seen::value};
    default:
      return {};
  }
}

/// Both forms: the parameters as constants, and as variables.
struct Operand {
  Seen constants, variables;
  bool of_parameters = false, of_t = false;
};

/// Whether the sign of a zero matters.
bool sees_signs(Operation o, const Operand& b) {
  return o == Operation::power || o == Operation::atan2 || (o == Operation::divide && b.of_t);
}

}  // namespace

bool same_with_variables(const Formula& formula) {
  std::vector<Operand> stack;
  const auto pop = [&stack] {
    const Operand top = stack.back();
    stack.pop_back();
    return top;
  };
  bool parameters = false, signs = false;
  for (const Instruction& step : formula.program) switch (step.operation) {
      case Operation::constant:
        stack.push_back({{Seen::value}, {Seen::value}});
        break;
      case Operation::time:
        stack.push_back({{Seen::variable, of_time}, {Seen::variable, of_time}, false, true});
        break;
      case Operation::variable:
        stack.push_back({{Seen::value}, {Seen::variable, step.target}, true});
        parameters = true;
        break;
      case Operation::jump:
      case Operation::jump_if_zero:
      case Operation::jump_if_not_zero:
      case Operation::truth:
        return false;
      default: {
        const bool two = takes_two(step.operation);
        const Operand b = two ? pop() : Operand{}, a = pop();
        Operand made{{}, {}, a.of_parameters || b.of_parameters, a.of_t || b.of_t};
        signs = signs || (two && sees_signs(step.operation, b));
        if (two) {
          const Made of_constants = of_two(step.operation, a.constants, b.constants),
                     of_variables = of_two(step.operation, a.variables, b.variables);
          if (made.of_parameters && !(of_constants.exact && of_variables.exact)) return false;
          made.constants = of_constants.seen;
          made.variables = of_variables.seen;
        } else {
          made.constants.kind = a.constants.kind == Seen::value ? Seen::value : Seen::other;
          made.variables.kind = a.variables.kind == Seen::value ? Seen::value : Seen::other;
        }
        stack.push_back(made);
      }
    }
  return !(parameters && signs);
}

}  // namespace bromwich
