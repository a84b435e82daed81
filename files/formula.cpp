#include "files/formula.hpp"

#include "core/base/error.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

namespace bromwich {

namespace {

using NamedOperation = std::pair<std::string_view, Operation>;

constexpr int deepest = 1000;

constexpr auto one_argument = std::to_array<NamedOperation>({
    {"sin", Operation::sin},     {"cos", Operation::cos},
    {"tan", Operation::tan},     {"asin", Operation::asin},
    {"acos", Operation::acos},   {"atan", Operation::atan},
    {"sinh", Operation::sinh},   {"cosh", Operation::cosh},
    {"tanh", Operation::tanh},   {"exp", Operation::exp},
    {"expm1", Operation::expm1}, {"log", Operation::log},
    {"ln", Operation::log},      {"log10", Operation::log10},
    {"log2", Operation::log2},   {"sqrt", Operation::sqrt},
    {"cbrt", Operation::cbrt},   {"erf", Operation::erf},
    {"erfc", Operation::erfc},   {"abs", Operation::abs},
    {"sign", Operation::sign},   {"heaviside", Operation::heaviside},
    {"floor", Operation::floor}, {"ceil", Operation::ceil},
    {"round", Operation::round},
});

constexpr auto two_arguments = std::to_array<NamedOperation>({
    {"pow", Operation::power},
    {"atan2", Operation::atan2},
    {"mod", Operation::mod},
});

constexpr auto many_arguments =
    std::to_array<NamedOperation>({{"min", Operation::minimum}, {"max", Operation::maximum}});

/// In the order of precedence, the lowest first; a longer sign precedes its own prefix.
constexpr auto comparisons = std::to_array<NamedOperation>({
    {"<=", Operation::less_equal},
    {">=", Operation::greater_equal},
    {"==", Operation::equal},
    {"!=", Operation::not_equal},
    {"<", Operation::less},
    {">", Operation::greater},
});
constexpr auto sums = std::to_array<NamedOperation>({{"+", Operation::add}, {"-", Operation::subtract}});
constexpr auto products = std::to_array<NamedOperation>({{"*", Operation::multiply}, {"/", Operation::divide}});

template <class Names>
std::optional<Operation> find(const Names& names, std::string_view word) {
  for (const auto& [name, operation] : names)
    if (name == word) return operation;
  return std::nullopt;
}

bool letter(char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0 || c == '_'; }
bool digit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }

class Reader {
 public:
  Reader(std::string_view text, const ParameterValues& parameters, const std::string& where,
         const std::map<std::string, std::size_t>& variables)
      : text_(text), parameters_(parameters), where_(where), variables_(variables) {}

  Formula read() {
    choice();
    if (!at_end()) fail();
    return std::move(formula_);
  }

 private:
  [[noreturn]] void fail() const {
    const std::string rest = one_line(text_.substr(std::min(place_, text_.size())).substr(0, 20));
    throw Error(where_,
                rest.empty() ? "the expression ends too early" : fmt::format("found '{}' in an expression", rest),
                "correct the expression");
  }

  void skip_blanks() {
    while (place_ < text_.size() && std::string_view(" \t\r\n").find(text_[place_]) != std::string_view::npos) ++place_;
  }
  bool at_end() {
    skip_blanks();
    return place_ == text_.size();
  }
  bool take(std::string_view sign) {
    skip_blanks();
    if (!text_.substr(place_).starts_with(sign)) return false;
    place_ += sign.size();
    return true;
  }
  void expect(std::string_view sign) {
    if (!take(sign)) fail();
  }
  template <class Names>
  std::optional<Operation> take_one(const Names& names) {
    for (const auto& [sign, operation] : names)
      if (take(sign)) return operation;
    return std::nullopt;
  }

  /// `change`: change of the number of values on the stack.
  std::size_t emit(Operation operation, int change, double value = 0) {
    formula_.program.push_back({operation, value, 0});
    height_ = std::size_t(long(height_) + change);
    formula_.depth = std::max(formula_.depth, height_);
    return formula_.program.size() - 1;
  }
  void emit_function(Operation operation, int change) {
    formula_.switches = formula_.switches || switches(operation);
    emit(operation, change);
  }
  void land(std::size_t jump) { formula_.program[jump].target = formula_.program.size(); }

  // c ? a : b
  void choice() {
    if (++nested_ > deepest) throw Error(where_, "the expression is nested too deeply", "name parts in [parameters]");
    any();
    if (take("?")) {
      const std::size_t to_else = emit(Operation::jump_if_zero, -1);
      choice();
      expect(":");
      const std::size_t to_end = emit(Operation::jump, -1);  // only one of the two values is on the stack
      land(to_else);
      choice();
      land(to_end);
    }
    --nested_;
  }

  // a || b is a ? 1 : truth(b)
  void any() {
    all();
    while (take("||")) either(Operation::jump_if_not_zero, 1, [this] { all(); });
  }
  void all() {
    chain(comparisons, [this] { sum(); });
    while (take("&&")) either(Operation::jump_if_zero, 0, [this] { chain(comparisons, [this] { sum(); }); });
  }
  template <class Read>
  void either(Operation decided, double value, const Read& right) {
    const std::size_t to_known = emit(decided, -1);
    right();
    emit(Operation::truth, 0);
    const std::size_t to_end = emit(Operation::jump, -1);
    land(to_known);
    emit(Operation::constant, 1, value);
    land(to_end);
  }

  void sum() {
    chain(sums, [this] { chain(products, [this] { signed_power(); }); });
  }

  template <class Names, class Read>
  void chain(const Names& names, const Read& next) {
    next();
    while (const auto operation = take_one(names)) {
      next();
      emit_function(*operation, -1);
    }
  }

  // -2^2 = -4, 2^-1 = 0.5, 2^3^2 = 512
  void signed_power() {
    if (++nested_ > deepest) throw Error(where_, "the expression is nested too deeply", "name parts in [parameters]");
    if (take("-")) {
      signed_power();
      emit(Operation::negative, 0);
    } else if (take("+")) {
      signed_power();
    } else {
      value();
      if (take("^")) {
        signed_power();
        emit(Operation::power, -1);
      }
    }
    --nested_;
  }

  void value() {
    skip_blanks();
    if (take("(")) {
      choice();
      expect(")");
    } else if (place_ < text_.size() && (digit(text_[place_]) || text_[place_] == '.')) {
      number();
    } else if (place_ < text_.size() && letter(text_[place_])) {
      name();
    } else {
      fail();
    }
  }

  void number() {
    std::size_t end = place_;
    const auto digits = [&] {
      while (end < text_.size() && (digit(text_[end]) || text_[end] == '.')) ++end;
    };
    digits();
    if (end < text_.size() && (text_[end] == 'e' || text_[end] == 'E')) {
      const std::size_t mantissa = end++;
      if (end < text_.size() && (text_[end] == '+' || text_[end] == '-')) ++end;
      const std::size_t exponent = end;
      digits();
      if (end == exponent) end = mantissa;
    }
    std::string word(text_.substr(place_, end - place_));
    if (word.front() == '.') word.insert(0, 1, '0');
    const auto value = parse_double(word);
    if (!value) fail();
    emit(Operation::constant, 1, *value);
    place_ = end;
  }

  void name() {
    std::size_t end = place_;
    while (end < text_.size() && (letter(text_[end]) || digit(text_[end]))) ++end;
    const std::string_view word = text_.substr(place_, end - place_);
    const std::size_t begin = std::exchange(place_, end);
    if (take("(")) {
      if (!call(word)) {
        place_ = begin;
        fail();
      }
      return;
    }
    const auto parameter = parameters_.find(std::string(word));
    if (word == "t") {
      emit(Operation::time, 1);
    } else if (word == "pi") {
      emit(Operation::constant, 1, std::numbers::pi);
    } else if (parameter != parameters_.end()) {
      emit(Operation::constant, 1, parameter->second);
    } else if (const auto variable = variables_.find(std::string(word)); variable != variables_.end()) {
      formula_.program[emit(Operation::variable, 1)].target = variable->second;
    } else {
      place_ = begin;
      fail();
    }
  }

  bool call(std::string_view word) {
    if (const auto one = find(one_argument, word)) {
      choice();
      expect(")");
      emit_function(*one, 0);
    } else if (const auto two = find(two_arguments, word)) {
      choice();
      expect(",");
      choice();
      expect(")");
      emit_function(*two, -1);
    } else if (const auto many = find(many_arguments, word)) {
      choice();
      while (take(",")) {
        choice();
        emit_function(*many, -1);
      }
      expect(")");
    } else {
      return false;
    }
    return true;
  }

  std::string_view text_;
  const ParameterValues& parameters_;
  const std::string& where_;
  const std::map<std::string, std::size_t>& variables_;
  std::size_t place_ = 0, height_ = 0;
  int nested_ = 0;
  Formula formula_;
};

struct Numbers {
  double t;
  static double constant(double value) { return value; }
  double time() const { return t; }
  static bool zero(double value) { return value == 0; }
  static std::optional<double> apply(Operation o, double a, double b) {
    return takes_two(o) ? bromwich::apply(o, a, b) : bromwich::apply(o, a);
  }
};

}  // namespace

double Formula::operator()(double t) const {
  std::vector<double> stack;
  stack.reserve(depth);
  Numbers numbers{t};
  return *execute(*this, numbers, stack);
}

Formula read_formula(std::string_view text, const ParameterValues& parameters, const std::string& where,
                     const std::map<std::string, std::size_t>& variables) {
  return Reader(text, parameters, where, variables).read();
}

}  // namespace bromwich
