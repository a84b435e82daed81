#pragma once
// The operations of expressions on one or two numbers.

namespace bromwich {

enum class Operation {
  constant,
  time,
  variable,  // push; `target` is its number
  add,
  subtract,
  multiply,
  divide,
  power,  // of two
  negative,
  less,
  less_equal,
  greater,
  greater_equal,
  equal,
  not_equal,
  truth,  // 1 or 0
  jump,
  jump_if_zero,
  jump_if_not_zero,  // to `target`; pops the value
  sin,
  cos,
  tan,
  asin,
  acos,
  atan,
  sinh,
  cosh,
  tanh,
  exp,
  expm1,
  log,
  log10,
  log2,
  sqrt,
  cbrt,
  erf,
  erfc,
  abs,
  sign,
  heaviside,
  floor,
  ceil,
  round,
  atan2,
  mod,
  minimum,
  maximum,  // of two
};

/// The value of an operation on one or two numbers.
double apply(Operation operation, double a);
double apply(Operation operation, double a, double b);

bool takes_two(Operation operation);
bool compares(Operation operation);
/// Jumps or has a kink somewhere; cbrt has no slope at 0.
bool switches(Operation operation);

}  // namespace bromwich
