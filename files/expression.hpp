#pragma once
// Expressions of parameters and of the time t, such as "-1/(R*C)" or "max(sin(2*pi*t), 0)".
//
// Names are the parameters, pi and, where allowed, t; definitions stand for expressions of them. Operators: + - * / ^
// (right to left, -2^2 = -4), comparisons (1 or 0), && ||, and condition ? a : b. The decimal separator is a point in
// every locale.

#include "catalogue/catalogue.hpp"
#include "core/base/time_function.hpp"
#include "core/base/types.hpp"
#include "files/formula.hpp"
#include "files/kept_values.hpp"
#include "files/switch_times.hpp"

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// "sin", "cos", ...: every function that an expression may call.
std::vector<std::string> expression_functions();

/// The switch times of one text, and the operations that were spent on them.
struct SwitchSearch {
  SwitchTimes found;
  long work = 0;
};
/// Those of several texts; not complete where they took too many operations together.
SwitchTimes together(const std::vector<SwitchSearch>&);

/// Makes numbers and functions of time from text. `where` is the argument of every Error: "rlcd.toml:7: dynamics.A".
class Expressions {
 public:
  Expressions();
  ~Expressions();
  Expressions(const Expressions&) = delete;
  Expressions& operator=(const Expressions&) = delete;

  /// Forgets parameters and definitions, which another scene of the file may define otherwise.
  void begin_scene();
  /// Values that are made from expressions; those of one scene serve the next.
  KeptValues& kept() const;

  /// Throws if `name` is not an identifier, is t, pi or a function, or is already defined.
  void define(const std::string& name, double value, const std::string& where);
  const ParameterValues& parameters() const;
  /// Whether it is the name of a parameter or of a definition.
  bool has(const std::string& name) const;

  /// A constant; throws if the text is not an expression, uses t or an unknown name, or is not finite.
  double number(const std::string& text, const std::string& where) const;

  /// Names an expression of t: later ones may use it. Throws as `define` and `in_full`.
  void define_in_time(const std::string& name, const std::string& text, const std::string& where);

  /// The expression of t and the parameters without definitions and other shorthands (files/shorthand.hpp). Throws if
  /// the text is no expression, or is constant and not finite.
  std::string in_full(const std::string& text, const std::string& where) const;

  /// A function with one entry per text of `in_full`. It may be called from several threads at once. Parts that do not
  /// depend on t are evaluated once, here.
  TimeFunction in_time(const std::vector<std::string>& texts) const;

  /// The expression of t, the parameters and `variables`, which have numbers, as a program. Throws if the text is no
  /// expression, or a variable that it uses has the name of a parameter.
  Formula formula(const std::string& text, const std::map<std::string, std::size_t>& variables,
                  const std::string& where) const;

  /// The times in [0, T] at which one of the texts of `in_full` may jump or have a kink.
  SwitchTimes switch_times(const std::vector<std::string>& texts, double T) const;
  /// The same of one text.
  SwitchSearch switch_search(const std::string& text, double T) const;

 private:
  void require_new(const std::string& name, const std::string& where) const;
  double evaluated(const std::string& text, const std::string& where) const;
  std::string spelled(const std::string& text, const std::string& where) const;
  std::optional<Formula> understood(const std::string& text, double T) const;

  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace bromwich
