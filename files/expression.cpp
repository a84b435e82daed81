#include "files/expression.hpp"

#include "core/base/error.hpp"
#include "core/base/time_function.hpp"
#include "files/formula.hpp"
#include "files/mu_parser.hpp"
#include "files/names.hpp"
#include "files/shorthand.hpp"
#include "files/spelling.hpp"
#include "files/time_vector.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <string_view>
#include <unordered_map>
#include <unordered_set>

namespace bromwich {

namespace {

constexpr const char* time_remedy = "only f, g, u, e, bound, definitions and exact solutions may depend on it";

/// Operations of formulas spent on the search for switch times: seconds at most.
constexpr long most_work = 50'000'000;  ///< 1.6 million edges of pulses
/// Functions of time up to which entries are sums of them: each value costs a product with this many columns.
constexpr Index most_columns = 32;

bool uses_time(std::string_view text) {
  const auto names = names_in(text);
  return std::any_of(names.begin(), names.end(), [](const Name& name) { return name.text == "t" && !name.called; });
}

bool contains(const std::vector<std::string>& words, const std::string& word) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

/// Whether an expression of the file may use the name, beside functions and variables.
bool known_in_file(const std::string& name, const Meanings& meanings, bool time_allowed) {
  return name == "pi" || (time_allowed && name == "t") || meanings.has(name);
}

std::vector<std::string> known_names(const Meanings& meanings, bool time_allowed,
                                     const std::map<std::string, std::size_t>& variables) {
  std::vector<std::string> known{"pi"};
  if (time_allowed) known.emplace_back("t");
  for (const auto& [name, value] : meanings.parameters) known.push_back(name);
  for (const auto& [name, meaning] : meanings.definitions) known.push_back(name);
  for (const auto& [name, number] : variables) known.push_back(name);
  return known;
}

/// Throws Error for a name that has no meaning at its place.
void check_name(const Name& found, const std::string& text, const Meanings& meanings, bool time_allowed,
                const std::string& where, const std::map<std::string, std::size_t>& variables) {
  static const auto functions = expression_functions();
  const auto& [name, begin, called] = found;
  const bool in_file = known_in_file(name, meanings, time_allowed), variable = variables.contains(name);
  if (!in_file && !variable) check_spelling(text, name, where);
  if (called && !contains(functions, name))
    throw Error(where, in_quotes(text) + fmt::format(" calls '{}'", name) + suggestion(name, functions),
                in_file || variable ? "write * to multiply" : "use one of the functions " + join(functions));
  if (!called && variable && in_file)
    throw Error(where, in_quotes(text) + fmt::format(" uses '{}', a component and a name of the file", name),
                "give one of the two another name");
  if (called || in_file || variable) return;
  if (contains(functions, name))
    throw Error(where, in_quotes(text) + fmt::format(" uses the function '{}' without arguments", name),
                fmt::format("write {}(...)", name));
  if (name == "t") throw Error(where, in_quotes(text) + " depends on the time t", time_remedy);
  const auto known = known_names(meanings, time_allowed, variables);
  throw Error(where, in_quotes(text) + fmt::format(" uses '{}', which is not defined", name) + suggestion(name, known),
              "define it in [parameters], before its first use, or use one of " + join(known));
}

/// Result of `use` of a parser; exceptions of muParser become an Error about the text.
template <typename Use>
auto guarded(const std::string& text, const std::string& where, const Use& use) {
  try {
    return use();
  } catch (const mu::Parser::exception_type& error) {
    throw Error(where, in_quotes(text) + " is no expression: " + one_line(error.GetMsg()), "correct it");
  }
}

/// A constant; the names were checked.
double evaluate(mu::Parser& parser, const std::string& text, const std::string& where) {
  return guarded(text, where, [&] {
    parser.SetExpr(text);
    return parser.Eval();
  });
}

double finite(double value, const std::string& text, const std::string& where) {
  if (!std::isfinite(value))
    throw Error(where, fmt::format("{} is {}", in_quotes(text), std::isnan(value) ? "not a number" : "infinite"),
                "check the divisions in it and the values of the parameters");
  return value;
}

}  // namespace

/// Texts that are remembered: of expressions for all entries there may be millions.
constexpr std::size_t most_texts = 10'000;

/// A parser for one use after the other: parameters are constants of it.
struct Expressions::Implementation {
  Meanings meanings;
  KeptValues kept{meanings};
  Programs programs;
  std::unordered_map<std::string, std::string> parsed_before;  ///< meanings, by their texts
  std::unordered_set<std::string> agreed_before;               ///< meanings
  double t = 0;
  mu::Parser parser = make_parser({}), parser_in_time = make_parser({});

  Implementation() { parser_in_time.DefineVar("t", &t); }
  Implementation(const Implementation&) = delete;
  Implementation& operator=(const Implementation&) = delete;

  /// Throws Error for what is no expression by its signs and names, and notes what it uses.
  void check(const std::string& text, bool time_allowed, const std::string& where,
             const std::map<std::string, std::size_t>& variables = {}) {
    check_signs(text, where);
    for (const Name& name : names_in(text)) {
      check_name(name, text, meanings, time_allowed, where, variables);
      if (!name.called && meanings.has(name.text)) kept.use(name.text);
    }
  }

  /// Throws Error for what muParser does not take, whatever the parameters are.
  void check_syntax(const std::string& text, const std::string& meaning, const std::string& where) {
    const auto before = parsed_before.find(text);
    if (before != parsed_before.end() && before->second == meaning) return;
    t = 0;
    evaluate(parser_in_time, meaning, where);
    evaluate(parser_in_time, "(" + meaning + ")", where);  // as it will be used
    if (before != parsed_before.end() || parsed_before.size() < most_texts) parsed_before[text] = meaning;
  }

  /// Whether muParser gives the values of the formula, with these or other parameters.
  bool agrees(const Formula& formula, const std::string& text, double T) {
    if (agreed_before.contains(text)) return true;
    parser_in_time.SetExpr("(" + text + ")");
    for (const double part : {0.0379, 0.2113, 0.4567, 0.7071, 0.9341}) {
      t = part * T;
      const double value = parser_in_time.Eval();
      if (std::abs(value - formula(t)) > 1e-6 * std::abs(value) + 1e-12) return false;
    }
    if (agreed_before.size() < most_texts) agreed_before.insert(text);
    return true;
  }
};

Expressions::Expressions() : implementation_(std::make_unique<Implementation>()) {}
Expressions::~Expressions() = default;

void Expressions::begin_scene() {
  implementation_->meanings = {};
  for (mu::Parser* parser : {&implementation_->parser, &implementation_->parser_in_time}) {
    parser->ClearConst();
    parser->DefineConst("pi", std::numbers::pi);
  }
}

KeptValues& Expressions::kept() const { return implementation_->kept; }
const ParameterValues& Expressions::parameters() const { return implementation_->meanings.parameters; }
bool Expressions::has(const std::string& name) const { return implementation_->meanings.has(name); }

void Expressions::require_new(const std::string& name, const std::string& where) const {
  static const auto functions = expression_functions();
  if (!is_name(name))
    throw Error(where, fmt::format("'{}' cannot be used in expressions", one_line(name)),
                "write a name of letters, digits and _ that does not begin with a digit");
  if (name == "t" || name == "pi" || contains(functions, name))
    throw Error(where, fmt::format("'{}' already has a meaning in expressions", name), "choose another name");
  if (has(name)) throw Error(where, fmt::format("'{}' is defined twice", name), "define it once");
}

void Expressions::define(const std::string& name, double value, const std::string& where) {
  require_new(name, where);
  implementation_->meanings.parameters.emplace(name, value);
  guarded(name, where, [&] {
    implementation_->parser.DefineConst(name, value);
    implementation_->parser_in_time.DefineConst(name, value);
    return 0;
  });
}

void Expressions::define_in_time(const std::string& name, const std::string& text, const std::string& where) {
  require_new(name, where);
  const std::string& meaning = kept().get("in full " + text, {}, [&] { return in_full(text, where); });
  implementation_->meanings.definitions.emplace(name, meaning);
}

double Expressions::evaluated(const std::string& text, const std::string& where) const {
  const double value =
      parsed(text) ? evaluate(implementation_->parser, text, where) : read_formula(text, parameters(), where)(0);
  return finite(value, text, where);
}

double Expressions::number(const std::string& text, const std::string& where) const {
  implementation_->check(text, false, where);
  const std::string meaning = spelled(text, where);
  if (uses_time(meaning)) throw Error(where, in_quotes(text) + " depends on the time t", time_remedy);
  return evaluated(meaning, where);
}

std::string Expressions::spelled(const std::string& text, const std::string& where) const {
  const auto constant = [&](const std::string& part) {
    if (uses_time(part))
      throw Error(where, fmt::format("{} depends on the time t in {}", in_quotes(part), in_quotes(text)),
                  "use t in the first argument of pulse and pwl only, and in the width of pulse(t, period, width)");
    return evaluated(part, where);
  };
  return spelled_out(text, implementation_->meanings.definitions, constant, where);
}

std::string Expressions::in_full(const std::string& text, const std::string& where) const {
  implementation_->check(text, true, where);
  std::string meaning = spelled(text, where);
  if (!uses_time(meaning)) {
    evaluated(meaning, where);
  } else if (!parsed(meaning)) {
    read_formula(meaning, parameters(), where);
  } else {
    implementation_->check_syntax(text, meaning, where);
  }
  return meaning;
}

Formula Expressions::formula(const std::string& text, const std::map<std::string, std::size_t>& variables,
                             const std::string& where) const {
  implementation_->check(text, true, where, variables);
  return read_formula(spelled(text, where), parameters(), where, variables);
}

// Entries of one text are one function of time with a column of its own, and constants are a column of another: large
// dynamics solve for columns, not for entries.
TimeFunction Expressions::in_time(const std::vector<std::string>& texts) const {
  Vector constants = Vector::Zero(Index(texts.size()));
  std::map<std::string, std::vector<Index>> of_time;
  for (std::size_t i = 0; i < texts.size(); ++i)
    if (uses_time(texts[i]))
      of_time[texts[i]].push_back(Index(i));
    else
      constants[Index(i)] = evaluated(texts[i], "expression");
  const Index constant = of_time.empty() || !constants.isZero(0) ? 1 : 0, columns = constant + Index(of_time.size());
  const bool together = columns < constants.size() && columns <= most_columns;
  Matrix shapes = Matrix::Zero(together ? constants.size() : 0, columns);
  std::vector<std::pair<Index, std::string>> functions;
  for (const auto& [text, rows] : of_time) {
    const Index column = constant + Index(functions.size());
    functions.emplace_back(together ? column : rows.front(), text);
    if (together) shapes(rows, column).setOnes();
  }
  if (!together) return time_vector(std::move(constants), functions, parameters(), implementation_->programs);
  if (constant == 1) shapes.col(0) = constants;
  if (functions.empty()) return SeparableSource{std::move(shapes), one_at_all_times()};
  return SeparableSource{std::move(shapes),
                         time_vector(Vector::Ones(columns), functions, parameters(), implementation_->programs)};
}

SwitchTimes Expressions::switch_times(const std::vector<std::string>& texts, double T) const {
  std::vector<SwitchSearch> all;
  std::set<std::string> seen;
  for (const std::string& text : texts)
    if (seen.insert(text).second) all.push_back(switch_search(text, T));
  return together(all);
}

SwitchSearch Expressions::switch_search(const std::string& text, double T) const {
  if (!uses_time(text)) return {};
  const std::optional<Formula> formula = understood(text, T);
  if (!formula) return {{{}, false}, 0};
  long left = most_work;
  SwitchTimes found = bromwich::switch_times(*formula, T, left);
  return {std::move(found), most_work - left};
}

SwitchTimes together(const std::vector<SwitchSearch>& all) {
  SwitchTimes found;
  long work = 0;
  for (const SwitchSearch& one : all) {
    found.times.insert(found.times.end(), one.found.times.begin(), one.found.times.end());
    work += one.work;
    found.complete = found.complete && one.found.complete && work <= most_work;
  }
  std::sort(found.times.begin(), found.times.end());
  found.times.erase(std::unique(found.times.begin(), found.times.end()), found.times.end());
  return found;
}

/// The formula of a text, if it has the same values as in muParser.
std::optional<Formula> Expressions::understood(const std::string& text, double T) const {
  try {
    Formula formula = read_formula(text, parameters(), "expression");
    if (!formula.switches || !parsed(text)) return formula;
    return implementation_->agrees(formula, text, T) ? std::optional(std::move(formula)) : std::nullopt;
  } catch (const Error&) {
    return std::nullopt;
  }
}

std::vector<std::string> expression_functions() {
  std::vector<std::string> names = parser_functions();
  for (const std::string& name : shorthand_functions()) names.push_back(name);
  return names;
}

}  // namespace bromwich
