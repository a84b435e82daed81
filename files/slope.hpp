#pragma once
// Derivatives of expressions: values with their slope with respect to one variable, carried through the program of a
// formula (forward mode; Griewank and Walther, Evaluating Derivatives, chapter 3). They are exact to rounding.
//
// Where an operation jumps or has a kink the slope is that of the side on which its value is taken: floor, sign and
// comparisons have slope 0, min and max that of the number they choose.

#include "files/formula.hpp"

#include <vector>

namespace bromwich {

struct Slope {
  double value = 0, slope = 0;
};

/// The derivative of an operation at a, and those at a and b.
double derivative(Operation, double a);
double derivative_by_first(Operation, double a, double b);
double derivative_by_second(Operation, double a, double b);

/// A domain for `execute`: the derivative with respect to variable `by`.
struct Slopes {
  double t;
  const std::vector<double>& variables;
  std::size_t by;

  static Slope constant(double value) { return {value, 0}; }
  Slope time() const { return {t, 0}; }
  Slope variable(std::size_t number) const { return {variables[number], double(number == by)}; }
  static bool zero(const Slope& s) { return s.value == 0; }
  static std::optional<Slope> apply(Operation, const Slope& a, const Slope& b);
};

/// A domain for `execute`: numbers, with variables.
struct VariableNumbers {
  double t;
  const std::vector<double>& variables;

  static double constant(double value) { return value; }
  double time() const { return t; }
  double variable(std::size_t number) const { return variables[number]; }
  static bool zero(double value) { return value == 0; }
  static std::optional<double> apply(Operation o, double a, double b) {
    return takes_two(o) ? bromwich::apply(o, a, b) : bromwich::apply(o, a);
  }
};

}  // namespace bromwich
