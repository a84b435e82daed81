#pragma once
// Numbers and expressions of netlists: 10u, 4k7, 2.2meg, {2*R + 1k}, 'a*b'.

#include "circuits/cards.hpp"

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace bromwich::circuits {

/// 4k7 = 4700, 10uF = 1e-5, 1meg = 1e6, 1F = 1e-15 (f is femto). Empty: the word is no number.
std::optional<double> spice_number(const std::string& word);
/// Whether it is one, or an expression in braces or quotes.
bool is_number(const std::string& word);

/// Parameters of one scope: .param, .func, and those of the scopes around it.
class Parameters {
 public:
  Parameters() = default;
  explicit Parameters(const Parameters* outer) : outer_(outer) {}

  /// In any order; the last definition of a name holds.
  void define(const std::string& name, const std::string& expression, const Place&);
  /// Replaces definitions of the netlist.
  void set(const std::string& name, double value);
  /// .func name(arguments) {expression}
  void define_function(const std::string& name, std::vector<std::string> arguments, const std::string& expression);

  bool has(const std::string& name) const;
  std::map<std::string, double> values() const;  ///< of this scope

  /// The value of a word: a number, an expression in braces or quotes, or the name of a parameter. Throws Error naming
  /// the place and `what`.
  double value(const std::string& word, const Place&, const std::string& what) const;
  /// Numbers without suffixes, parameters as their values, functions expanded: text for files/expression.hpp.
  std::string plain(const std::string& expression, const Place&, int depth = 0) const;

 private:
  struct Definition {
    std::string expression;
    Place place;
    mutable std::optional<double> value = {};
    mutable bool open = false;  ///< is being evaluated
    bool argument = false;      ///< of a function: stands for its text
  };
  struct Function {
    std::vector<std::string> arguments;
    std::string expression;
  };
  const Definition* find(const std::string& name, const Parameters*& scope) const;
  const Function* find_function(const std::string& name) const;
  double of(const Definition&) const;

  const Parameters* outer_ = nullptr;
  std::map<std::string, Definition> definitions_;
  std::map<std::string, Function> functions_;
};

/// "a*b" of "{a*b}" or "'a*b'".
std::string without_braces(const std::string&);

}  // namespace bromwich::circuits
