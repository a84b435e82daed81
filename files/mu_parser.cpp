#include "files/mu_parser.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

template <typename Pointer>
struct Named {
  const char* name;
  Pointer function;
};

using Unary = double (*)(double);
using Binary = double (*)(double, double);
using Variadic = double (*)(const double*, int);

constexpr std::array<Named<Unary>, 25> unary{{
    {"sin", [](double s) { return std::sin(s); }},
    {"cos", [](double s) { return std::cos(s); }},
    {"tan", [](double s) { return std::tan(s); }},
    {"asin", [](double s) { return std::asin(s); }},
    {"acos", [](double s) { return std::acos(s); }},
    {"atan", [](double s) { return std::atan(s); }},
    {"sinh", [](double s) { return std::sinh(s); }},
    {"cosh", [](double s) { return std::cosh(s); }},
    {"tanh", [](double s) { return std::tanh(s); }},
    {"exp", [](double s) { return std::exp(s); }},
    {"expm1", [](double s) { return std::expm1(s); }},
    {"log", [](double s) { return std::log(s); }},
    {"ln", [](double s) { return std::log(s); }},
    {"log10", [](double s) { return std::log10(s); }},
    {"log2", [](double s) { return std::log2(s); }},
    {"sqrt", [](double s) { return std::sqrt(s); }},
    {"cbrt", [](double s) { return std::cbrt(s); }},
    {"erf", [](double s) { return std::erf(s); }},
    {"erfc", [](double s) { return std::erfc(s); }},
    {"abs", [](double s) { return std::abs(s); }},
    {"sign", [](double s) { return double(s > 0) - double(s < 0); }},
    {"heaviside", [](double s) { return double(s >= 0); }},
    {"floor", [](double s) { return std::floor(s); }},
    {"ceil", [](double s) { return std::ceil(s); }},
    {"round", [](double s) { return std::round(s); }},
}};

constexpr std::array<Named<Binary>, 3> binary{{
    {"pow", [](double a, double b) { return std::pow(a, b); }},
    {"atan2", [](double y, double x) { return std::atan2(y, x); }},
    // In [0, b), also for negative a: mod(t, period) is periodic on the whole axis.
    {"mod", [](double a, double b) { return a - b * std::floor(a / b); }},
}};

constexpr std::array<Named<Variadic>, 2> variadic{{
    {"min", [](const double* values, int count) { return *std::min_element(values, values + count); }},
    {"max", [](const double* values, int count) { return *std::max_element(values, values + count); }},
}};

}  // namespace

mu::Parser make_parser(const ParameterValues& parameters) {
  static const mu::Parser without_parameters = [] {
    mu::Parser made;
    made.ClearFun();
    made.ClearConst();
    for (const auto& [name, function] : unary) made.DefineFun(name, function);
    for (const auto& [name, function] : binary) made.DefineFun(name, function);
    for (const auto& [name, function] : variadic) made.DefineFun(name, function);
    made.DefineConst("pi", std::numbers::pi);
    return made;
  }();
  mu::Parser parser = without_parameters;
  for (const auto& [name, value] : parameters) parser.DefineConst(name, value);
  return parser;
}

std::vector<std::string> parser_functions() {
  std::vector<std::string> names;
  for (const auto& entry : unary) names.emplace_back(entry.name);
  for (const auto& entry : binary) names.emplace_back(entry.name);
  for (const auto& entry : variadic) names.emplace_back(entry.name);
  return names;
}

}  // namespace bromwich
