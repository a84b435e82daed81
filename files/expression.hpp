#pragma once
// Expressions of parameters and of the time t, such as "-1/(R*C)" or "max(sin(2*pi*t), 0)".
//
// Names are the parameters, pi and, where it is allowed, t. Operators: + - * / ^ (right to left, -2^2 = -4),
// comparisons (1 or 0), && ||, and condition ? a : b. Decimals are written with a point, whatever the locale.

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

/// Numbers and functions of time from text. `where` is the argument of every Error thrown: "rlcd.toml:7: dynamics.A".
class Expressions {
 public:
  Expressions();
  ~Expressions();
  Expressions(const Expressions&) = delete;
  Expressions& operator=(const Expressions&) = delete;

  /// Throws where `name` is no identifier, is t, pi or a function, or is defined already.
  void define(const std::string& name, double value, const std::string& where);
  const ParameterValues& parameters() const;

  /// A constant; throws where the text is none, uses t or an unknown name, or is not finite.
  double number(const std::string& text, const std::string& where) const;

  /// Throws where the text is no expression of t and the parameters, or is constant and not finite.
  void check_in_time(const std::string& text, const std::string& where) const;

  /// One entry per text, each checked before. May be called from several threads at once; what does not depend on t is
  /// evaluated here and never again.
  TimeFunction in_time(const std::vector<std::string>& texts) const;

  /// The times in [0, T] at which one of the texts may jump or have a kink.
  SwitchTimes switch_times(const std::vector<std::string>& texts, double T) const;

 private:
  std::optional<Formula> understood(const std::string& text, double T) const;

  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace bromwich
