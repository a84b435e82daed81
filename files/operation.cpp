#include "files/operation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

using Unary = double (*)(double);
using Binary = double (*)(double, double);

template <typename Function>
using Meaning = std::pair<Operation, Function>;

constexpr auto of_one = std::to_array<Meaning<Unary>>({
    {Operation::negative, [](double s) { return -s; }},
    {Operation::truth, [](double s) { return double(s != 0); }},
    {Operation::sin, [](double s) { return std::sin(s); }},
    {Operation::cos, [](double s) { return std::cos(s); }},
    {Operation::tan, [](double s) { return std::tan(s); }},
    {Operation::asin, [](double s) { return std::asin(s); }},
    {Operation::acos, [](double s) { return std::acos(s); }},
    {Operation::atan, [](double s) { return std::atan(s); }},
    {Operation::sinh, [](double s) { return std::sinh(s); }},
    {Operation::cosh, [](double s) { return std::cosh(s); }},
    {Operation::tanh, [](double s) { return std::tanh(s); }},
    {Operation::exp, [](double s) { return std::exp(s); }},
    {Operation::expm1, [](double s) { return std::expm1(s); }},
    {Operation::log, [](double s) { return std::log(s); }},
    {Operation::log10, [](double s) { return std::log10(s); }},
    {Operation::log2, [](double s) { return std::log2(s); }},
    {Operation::sqrt, [](double s) { return std::sqrt(s); }},
    {Operation::cbrt, [](double s) { return std::cbrt(s); }},
    {Operation::erf, [](double s) { return std::erf(s); }},
    {Operation::erfc, [](double s) { return std::erfc(s); }},
    {Operation::abs, [](double s) { return std::abs(s); }},
    {Operation::sign, [](double s) { return double(s > 0) - double(s < 0); }},
    {Operation::heaviside, [](double s) { return double(s >= 0); }},
    {Operation::floor, [](double s) { return std::floor(s); }},
    {Operation::ceil, [](double s) { return std::ceil(s); }},
    {Operation::round, [](double s) { return std::round(s); }},
});

constexpr auto of_two = std::to_array<Meaning<Binary>>({
    {Operation::add, [](double a, double b) { return a + b; }},
    {Operation::subtract, [](double a, double b) { return a - b; }},
    {Operation::multiply, [](double a, double b) { return a * b; }},
    {Operation::divide, [](double a, double b) { return a / b; }},
    {Operation::power, [](double a, double b) { return std::pow(a, b); }},
    {Operation::less, [](double a, double b) { return double(a < b); }},
    {Operation::less_equal, [](double a, double b) { return double(a <= b); }},
    {Operation::greater, [](double a, double b) { return double(a > b); }},
    {Operation::greater_equal, [](double a, double b) { return double(a >= b); }},
    {Operation::equal, [](double a, double b) { return double(a == b); }},
    {Operation::not_equal, [](double a, double b) { return double(a != b); }},
    {Operation::atan2, [](double y, double x) { return std::atan2(y, x); }},
    {Operation::mod, [](double a, double b) { return a - b * std::floor(a / b); }},
    {Operation::minimum, [](double a, double b) { return std::min(a, b); }},
    {Operation::maximum, [](double a, double b) { return std::max(a, b); }},
});

/// By operation; null for other operations.
template <typename Function, std::size_t count>
constexpr auto by_operation(const std::array<Meaning<Function>, count>& meanings) {
  std::array<Function, std::size_t(Operation::maximum) + 1> table{};
  for (const auto& [operation, function] : meanings) table[std::size_t(operation)] = function;
  return table;
}

constexpr auto functions_of_one = by_operation(of_one);
constexpr auto functions_of_two = by_operation(of_two);

}  // namespace

double apply(Operation operation, double a) { return functions_of_one[std::size_t(operation)](a); }
double apply(Operation operation, double a, double b) { return functions_of_two[std::size_t(operation)](a, b); }

bool takes_two(Operation operation) { return functions_of_two[std::size_t(operation)] != nullptr; }

bool compares(Operation operation) { return operation >= Operation::less && operation <= Operation::not_equal; }

bool switches(Operation operation) {
  return compares(operation) || operation == Operation::cbrt || operation >= Operation::abs;
}

}  // namespace bromwich
