#pragma once
// Expressions of parameters and of the time t, such as "-1/(R*C)" or "max(sin(2*pi*t), 0)".
//
// Names are the parameters, pi and, where allowed, t. Operators: + - * / ^ (right to left, -2^2 = -4), comparisons (1
// or 0), && ||, and condition ? a : b. The decimal separator is a point in every locale.

#include "core/base/time_function.hpp"
#include "core/base/types.hpp"
#include "core/catalogue/catalogue.hpp"
#include "files/switch_times.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// "sin", "cos", ...: every function that an expression may call.
std::vector<std::string> expression_functions();

/// Makes numbers and functions of time from text. `where` is the argument of every Error: "rlcd.toml:7: dynamics.A".
class Expressions {
 public:
  Expressions();
  ~Expressions();
  Expressions(const Expressions&) = delete;
  Expressions& operator=(const Expressions&) = delete;

  /// Throws if `name` is not an identifier, is t, pi or a function, or is already defined.
  void define(const std::string& name, double value, const std::string& where);
  const ParameterValues& parameters() const;

  /// A constant; throws if the text is not an expression, uses t or an unknown name, or is not finite.
  double number(const std::string& text, const std::string& where) const;

  /// Throws if the text is not an expression of t and the parameters, or is constant and not finite.
  void check_in_time(const std::string& text, const std::string& where) const;

  /// A function with one entry per text; the texts must have been checked. It may be called from several threads at
  /// once. Parts that do not depend on t are evaluated once, here.
  TimeFunction in_time(const std::vector<std::string>& texts) const;

  /// The times in [0, T] at which one of the texts may jump or have a kink.
  SwitchTimes switch_times(const std::vector<std::string>& texts, double T) const;

 private:
  std::optional<Formula> understood(const std::string& text, double T) const;

  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace bromwich
