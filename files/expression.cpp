#include "files/expression.hpp"

#include "core/base/error.hpp"
#include "files/formula.hpp"
#include "files/names.hpp"
#include "files/shorthand.hpp"
#include "files/spelling.hpp"
#include "files/words.hpp"

#include <fmt/format.h>
#include <muParser.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <numbers>
#include <set>
#include <string_view>
#include <unordered_map>

namespace bromwich {

namespace {

/// muParser evaluates several results in one call, but rejects long texts: expressions share a parser up to this
/// length.
constexpr std::size_t longest_batch = 4000;
/// Longer texts are rejected by muParser even alone: they are evaluated as a Formula.
constexpr std::size_t longest_parsed = 19'000;

constexpr const char* time_remedy = "only f, g, u, e, definitions and exact solutions may depend on it";

/// Operations of formulas spent on the search for switch times: seconds at most.
constexpr long most_work = 20'000'000;

bool parsed(const std::string& text) { return text.size() <= longest_parsed; }

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

/// A parser with only the functions and constants above, without muParser's own.
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

/// The parsers of one thread. muParser stores the address of t, so they must not be moved.
class ParserSet {
 public:
  ParserSet(const std::vector<std::string>& texts, const ParameterValues& parameters) {
    for (std::size_t begin = 0; begin < texts.size();) {
      std::string batch;
      std::size_t end = begin;
      for (; end < texts.size() && (end == begin || batch.size() + texts[end].size() < longest_batch); ++end)
        batch += (end == begin ? "(" : ",(") + texts[end] + ")";
      parsers_.push_back(make_parser(parameters));
      parsers_.back().DefineVar("t", &t_);
      parsers_.back().SetExpr(batch);
      begin = end;
    }
  }
  ParserSet(const ParserSet&) = delete;
  ParserSet& operator=(const ParserSet&) = delete;

  /// Calls `write` for every value, in the order of the texts.
  template <typename Write>
  void evaluate(double t, const Write& write) {
    t_ = t;
    std::size_t next = 0;
    for (mu::Parser& parser : parsers_) {
      int count = 0;
      const double* values = parser.Eval(count);
      for (int i = 0; i < count; ++i) write(next++, values[i]);
    }
  }

 private:
  double t_ = 0;
  std::vector<mu::Parser> parsers_;
};

/// Parser sets that no thread is using. A thread takes one, or makes one if all are in use.
class TimeVector {
 public:
  TimeVector(Vector constants, ParameterValues parameters)
      : constants_(std::move(constants)), parameters_(std::move(parameters)) {}

  /// Value of entry `row`; its text was checked before.
  void add(Index row, const std::string& text) {
    if (!parsed(text)) {
      long_.emplace_back(row, read_formula(text, parameters_, "expression"));
      return;
    }
    rows_.push_back(row);
    texts_.push_back(text);
  }

  void operator()(double t, Eigen::Ref<Vector> value) {
    value = constants_;
    for (const auto& [row, formula] : long_) value[row] = formula(t);
    if (rows_.empty()) return;
    std::unique_ptr<ParserSet> set = take();
    set->evaluate(t, [&](std::size_t i, double entry) { value[rows_[i]] = entry; });
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(set));
  }

 private:
  std::unique_ptr<ParserSet> take() {
    {
      const std::lock_guard lock(mutex_);
      if (!idle_.empty()) {
        auto set = std::move(idle_.back());
        idle_.pop_back();
        return set;
      }
    }
    return std::make_unique<ParserSet>(texts_, parameters_);
  }

  Vector constants_;
  std::vector<Index> rows_;  ///< texts_[i] is the entry rows_[i]
  std::vector<std::string> texts_;
  std::vector<std::pair<Index, Formula>> long_;
  ParameterValues parameters_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<ParserSet>> idle_;
};

}  // namespace

/// A parser for one use after the other: parameters are constants of it.
struct Expressions::Implementation {
  Meanings meanings;
  KeptValues kept{meanings};
  std::unordered_map<std::string, std::string> parsed_before;  ///< meanings, by their texts
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
    constexpr std::size_t most_texts = 10'000;  // of expressions for all entries there may be millions
    const auto before = parsed_before.find(text);
    if (before != parsed_before.end() && before->second == meaning) return;
    t = 0;
    evaluate(parser_in_time, meaning, where);
    evaluate(parser_in_time, "(" + meaning + ")", where);  // as it will be used
    if (before != parsed_before.end() || parsed_before.size() < most_texts) parsed_before[text] = meaning;
  }

  /// Whether muParser gives the values of the formula.
  bool agrees(const Formula& formula, const std::string& text, double T) {
    parser_in_time.SetExpr("(" + text + ")");
    constexpr std::array parts{0.0379, 0.2113, 0.4567, 0.7071, 0.9341};
    return std::all_of(parts.begin(), parts.end(), [&](double part) {
      t = part * T;
      const double value = parser_in_time.Eval();
      return !(std::abs(value - formula(t)) > 1e-6 * std::abs(value) + 1e-12);
    });
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

TimeFunction Expressions::in_time(const std::vector<std::string>& texts) const {
  Vector constants = Vector::Zero(Index(texts.size()));
  for (std::size_t i = 0; i < texts.size(); ++i)
    if (!uses_time(texts[i])) constants[Index(i)] = evaluated(texts[i], "expression");
  auto function = std::make_shared<TimeVector>(std::move(constants), parameters());
  for (std::size_t i = 0; i < texts.size(); ++i)
    if (uses_time(texts[i])) function->add(Index(i), texts[i]);
  return [function](double t, Eigen::Ref<Vector> value) { (*function)(t, value); };
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
  std::vector<std::string> names;
  for (const auto& entry : unary) names.emplace_back(entry.name);
  for (const auto& entry : binary) names.emplace_back(entry.name);
  for (const auto& entry : variadic) names.emplace_back(entry.name);
  for (const std::string& name : shorthand_functions()) names.push_back(name);
  return names;
}

}  // namespace bromwich
