#include "circuits/behaviour.hpp"

#include "core/base/error.hpp"

#include <fmt/format.h>

#include <cctype>
#include <cmath>
#include <cstdlib>
#include <map>

namespace bromwich::circuits {

namespace {

constexpr int deepest = 200;  ///< nested parentheses

bool of_name(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '.'; }

/// A constant, terms by the number of the variable, and an expression of time alone; empty: 0.
struct Affine {
  double constant = 0;
  std::map<std::size_t, double> terms = {};
  std::string of_time = {};

  bool is_constant() const { return terms.empty() && of_time.empty(); }
  /// Whether it is one of time, without voltages and currents.
  bool is_of_time() const { return terms.empty() && !of_time.empty(); }
  Affine& add(const Affine& other, double factor) {
    constant += factor * other.constant;
    for (const auto& [variable, k] : other.terms)
      if ((terms[variable] += factor * k) == 0) terms.erase(variable);
    if (!other.of_time.empty() && factor != 0)
      of_time += fmt::format("{}({:.17g})*({})", of_time.empty() ? "" : "+", factor, other.of_time);
    return *this;
  }
  /// Of one without terms.
  std::string text() const {
    return of_time.empty() ? fmt::format("({:.17g})", constant) : fmt::format("({:.17g}+{})", constant, of_time);
  }
};
Affine of_time(std::string text) { return {0, {}, std::move(text)}; }
bool without_signals(const Affine& a, const Affine& b) { return a.terms.empty() && b.terms.empty(); }
Affine sum(Affine a, const Affine& b, double factor = 1) { return a.add(b, factor); }
Affine times(const Affine& a, double factor) { return Affine{}.add(a, factor); }

class Behaviour {
 public:
  Behaviour(Element source, const Parameters& parameters, const BehaviourNames& names)
      : source_(std::move(source)), names_(names) {
    parameters_ = &parameters;
  }

  std::vector<Element> read(const std::string& expression) {
    std::string inner = lower(without_quotes(expression));
    for (char& c : inner) c = c == '{' ? '(' : c == '}' ? ')' : c;
    text_ = parameters_->plain(with_variables(inner), source_.place);
    const Affine value = conditional();
    if (peek() != '\0') refuse(fmt::format("'{}' is not understood", text_.substr(at_)));
    set_form(source_, with_source(value));
    made_.push_back(std::move(source_));
    return std::move(made_);
  }

 private:
  [[noreturn]] void refuse(const std::string& found) const {
    throw Error(to_string(source_.place), fmt::format("{}: {}", source_.name, found),
                "write sums of V(a), V(a,b) and I(V1) with constant factors, and max, min, abs, limit, table, u and "
                "if(a>b, x, y) of them; beside them any function of time");
  }

  static std::string without_quotes(const std::string& s) {
    const bool quoted = s.size() >= 2 && (s.front() == '\'' || s.front() == '"') && s.back() == s.front();
    return quoted ? s.substr(1, s.size() - 2) : s;
  }

  // V(a), V(a, b) and I(x) as names of variables.
  std::string with_variables(const std::string& s) {
    std::string out;
    for (std::size_t i = 0; i < s.size();) {
      const bool begins = i == 0 || !of_name(s[i - 1]);
      const std::size_t open = s.find_first_not_of(' ', i + 1);
      if (!begins || (s[i] != 'v' && s[i] != 'i') || open == std::string::npos || s[open] != '(') {
        out += s[i++];
        continue;
      }
      const std::size_t close = s.find(')', open);
      if (close == std::string::npos) refuse("'(' has no ')'");
      variables_.push_back(variable(s[i], s.substr(open + 1, close - open - 1)));
      out += fmt::format("probe_{}", variables_.size() - 1);
      i = close + 1;
    }
    return out;
  }

  LinearForm variable(char kind, const std::string& inner) const {
    const std::vector<std::string> words = split_arguments(inner);
    LinearForm form;
    if (kind == 'i' && words.size() == 1)
      form.currents.push_back({names_.element(words[0]), 1});
    else if (kind == 'v' && (words.size() == 1 || words.size() == 2))
      form.voltages.push_back({names_.node(words[0]), words.size() == 2 ? names_.node(words[1]) : "0", 1});
    else
      refuse(fmt::format("found '{}({})'", kind, inner));
    return form;
  }

  void set_form(Element& e, const Affine& a) const {
    LinearForm form;
    form.constant = a.constant;
    for (const auto& [number, factor] : a.terms) {
      const LinearForm& v = variables_[number];
      for (auto one : v.voltages) one.factor *= factor, form.voltages.push_back(one);
      for (auto one : v.currents) one.factor *= factor, form.currents.push_back(one);
    }
    bool finite = std::isfinite(form.constant);
    for (const auto& one : form.voltages) finite = finite && std::isfinite(one.factor);
    for (const auto& one : form.currents) finite = finite && std::isfinite(one.factor);
    if (!finite) refuse("has a number that is not finite");
    for (const auto& one : form.voltages) e.nodes.insert(e.nodes.end(), {one.from, one.to});
    e.form = std::move(form);
  }

  // A hidden node whose voltage is max(0, a), of kind P, or 1 where a > 0, of kind U.
  Affine hidden(char kind, const Affine& a, double above = 0, double below = 0) {
    if (a.is_constant()) return {kind == 'P' ? std::max(0.0, a.constant) : double(a.constant > above)};
    if (a.is_of_time() && above == below)
      return of_time(kind == 'P' ? fmt::format("max(0,{})", a.text()) : fmt::format("({}>({:.17g}))", a.text(), above));
    const Affine form = with_source(a);
    Element e = hidden_element(kind, kind == 'P' ? "max" : "u");
    set_form(e, form);
    e.gate.threshold = (above + below) / 2, e.gate.hysteresis = (above - below) / 2;
    return made(std::move(e));
  }

  // What depends on time alone as the voltage of a hidden node.
  Affine with_source(Affine a) {
    if (a.of_time.empty()) return a;
    Element e = hidden_element('V', "time");
    e.source = waveform_of_time(a.of_time, source_.place);
    a.of_time.clear();
    return sum(std::move(a), made(std::move(e)));
  }

  Element hidden_element(char kind, const char* word) const {
    Element e;
    e.kind = kind;
    e.place = source_.place;
    e.hidden = true;
    e.name = fmt::format("{}.{}{}", source_.name, word, made_.size() + 1);
    e.nodes = {names_.node(lower(e.name)), "0"};
    return e;
  }

  // The voltage of its node.
  Affine made(Element e) {
    variables_.push_back({0, {{e.nodes[0], "0", 1}}, {}});
    made_.push_back(std::move(e));
    return {0, {{variables_.size() - 1, 1}}};
  }

  // ---- The text, after Parameters::plain.

  char peek() {
    while (at_ < text_.size() && text_[at_] == ' ') ++at_;
    return at_ < text_.size() ? text_[at_] : '\0';
  }
  bool take(const char* word) {
    peek();
    const std::string w = word;
    if (text_.compare(at_, w.size(), w) != 0) return false;
    at_ += w.size();
    return true;
  }
  void expect(const char* word) {
    if (!take(word))
      refuse(fmt::format("'{}' is missing before '{}'", word, text_.substr(std::min(at_, text_.size()))));
  }

  Affine conditional() {
    if (++depth_ > deepest) refuse("is nested too deeply");
    Affine value = either();
    if (take("?")) {
      const Affine yes = conditional();
      expect(":");
      const Affine no = conditional();
      const Affine difference = sum(yes, no, -1);
      if (value.is_constant())
        value = value.constant != 0 ? yes : no;
      else if (value.is_of_time() && without_signals(yes, no))
        value = of_time(fmt::format("({}?{}:{})", value.text(), yes.text(), no.text()));
      else if (difference.is_constant())
        value = sum(no, value, difference.constant);
      else
        refuse("jumps between values that are not constant");
    }
    --depth_;
    return value;
  }

  Affine either() {
    Affine a = both();
    while (take("||") || take("|")) a = hidden('U', sum(sum(a, both()), {0.5}, -1));
    return a;
  }
  Affine both() {
    Affine a = compared();
    while (take("&&") || take("&")) a = hidden('U', sum(sum(a, compared()), {1.5}, -1));
    return a;
  }
  Affine compared() {
    const Affine a = added();
    if (take(">=") || take(">")) return hidden('U', sum(a, added(), -1));
    if (take("<=") || take("<")) return hidden('U', sum(added(), a, -1));
    return a;
  }
  Affine added() {
    Affine a = multiplied();
    for (;;) {
      if (take("+"))
        a.add(multiplied(), 1);
      else if (take("-"))
        a.add(multiplied(), -1);
      else
        return a;
    }
  }
  Affine multiplied() {
    Affine a = signed_value();
    for (;;) {
      const bool product = take("*");
      if (!product && !take("/")) return a;
      const Affine b = signed_value();
      if (!b.is_constant() && without_signals(a, b)) {
        a = of_time(fmt::format("({}{}{})", a.text(), product ? '*' : '/', b.text()));
        continue;
      }
      if (!b.is_constant() && !(product && a.is_constant())) refuse("has a product or a quotient of signals");
      if (!product && b.constant == 0) refuse("divides by 0");
      a = b.is_constant() ? times(a, product ? b.constant : 1 / b.constant) : times(b, a.constant);
    }
  }
  Affine signed_value() {
    if (take("-")) return times(signed_value(), -1);
    if (take("+")) return signed_value();
    if (peek() == '!' && at_ + 1 < text_.size() && text_[at_ + 1] != '=') {
      take("!");
      return sum({1}, signed_value(), -1);
    }
    const Affine a = primary();
    if (!take("^")) return a;
    const Affine b = signed_value();
    if (!without_signals(a, b)) refuse("has a power of signals");
    if (!a.is_constant() || !b.is_constant()) return of_time(fmt::format("({}^{})", a.text(), b.text()));
    return {std::pow(a.constant, b.constant)};
  }

  Affine primary() {
    if (take("(")) {
      const Affine a = conditional();
      expect(")");
      return a;
    }
    const char c = peek();
    if (std::isdigit(static_cast<unsigned char>(c)) != 0 || c == '.') {
      char* end = nullptr;
      const double value = std::strtod(text_.c_str() + at_, &end);
      at_ = std::size_t(end - text_.c_str());
      return {value};
    }
    std::string name;
    while (at_ < text_.size() && of_name(text_[at_])) name += text_[at_++];
    if (name.empty()) refuse(c == '\0' ? std::string("ends too early") : fmt::format("'{}' is not understood", c));
    if (name.starts_with("probe_")) return {0, {{std::size_t(std::stoul(name.substr(6))), 1}}};
    if (peek() == '(') return called(name);
    if (name == "pi") return {3.14159265358979323846};
    if (name == "time") return of_time("time");
    refuse(fmt::format("'{}' is unknown", name));
  }

  std::vector<Affine> arguments() {
    std::vector<Affine> all;
    expect("(");
    do all.push_back(conditional());
    while (take(","));
    expect(")");
    return all;
  }

  Affine called(const std::string& name) {
    const std::vector<Affine> a = arguments();
    const auto count = [&](std::size_t wanted) {
      if (a.size() != wanted) refuse(fmt::format("{} takes {} arguments, found {}", name, wanted, a.size()));
    };
    if (name == "max" || name == "min") {
      count(2);
      const Affine above = hidden('P', sum(a[0], a[1], -1));
      return name == "max" ? sum(a[1], above) : sum(a[0], above, -1);
    }
    if (name == "limit") return limited(a);
    if (name == "schmitt") {  // 1 from a[0] > a[2] on, 0 from a[0] < a[1] on
      count(3);
      if (!a[1].is_constant() || !a[2].is_constant() || !(a[2].constant >= a[1].constant))
        refuse("schmitt has levels that are not constant, or do not increase");
      return hidden('U', a[0], a[2].constant, a[1].constant);
    }
    if (name == "table" || name == "tbl") return tabulated(a);
    count(1);
    if (name == "uramp") return hidden('P', a[0]);
    if (name == "abs" && a[0].is_of_time()) return of_time("abs" + a[0].text());
    if (name == "abs") return sum(times(hidden('P', a[0]), 2), a[0], -1);
    if (name == "u" || name == "stp" || name == "ustep") return hidden('U', a[0]);
    if (name == "sgn") return sum(times(hidden('U', a[0]), 2), {1}, -1);
    if (name == "buf" || name == "inv") {
      const Affine on = hidden('U', sum(a[0], {0.5}, -1));
      return name == "buf" ? on : sum({1}, on, -1);
    }
    return of_constant(name, a[0]);
  }

  Affine of_constant(const std::string& name, const Affine& a) const {
    static const std::map<std::string, double (*)(double)> known{
        {"sin", std::sin}, {"cos", std::cos},   {"tan", std::tan},     {"exp", std::exp},
        {"log", std::log}, {"sqrt", std::sqrt}, {"log10", std::log10}, {"atan", std::atan}};
    const auto f = known.find(name);
    if (f == known.end()) refuse(fmt::format("'{}' is unknown", name));
    if (a.is_of_time()) return of_time(fmt::format("{}{}", name == "log" ? "ln" : name, a.text()));
    if (!a.is_constant()) refuse(fmt::format("{} of a signal is not linear in pieces", name));
    return {f->second(a.constant)};
  }

  // Between two constants.
  Affine limited(const std::vector<Affine>& a) {
    if (a.size() != 3) refuse(fmt::format("limit takes 3 arguments, found {}", a.size()));
    if (!a[1].is_constant() || !a[2].is_constant()) refuse("limit has bounds that are not constant");
    const Affine low{std::min(a[1].constant, a[2].constant)}, high{std::max(a[1].constant, a[2].constant)};
    const Affine above_low = hidden('P', sum(a[0], low, -1)), above_high = hidden('P', sum(a[0], high, -1));
    return sum(sum(low, above_low), above_high, -1);
  }

  // Lines between points, and constant outside of them.
  Affine tabulated(const std::vector<Affine>& a) {
    if (a.size() < 3 || a.size() % 2 == 0) refuse("table has no pairs of numbers");
    for (std::size_t k = 1; k < a.size(); ++k)
      if (!a[k].is_constant()) refuse("table has numbers that are not constant");
    Affine value = a[2];
    double slope = 0;
    for (std::size_t k = 1; k < a.size(); k += 2) {
      double next = 0;
      if (k + 2 < a.size()) {
        const double step = a[k + 2].constant - a[k].constant;
        if (!(step > 0)) refuse("table has places that do not increase");
        next = (a[k + 3].constant - a[k + 1].constant) / step;
      }
      if (next != slope) value.add(hidden('P', sum(a[0], a[k], -1)), next - slope);
      slope = next;
    }
    return value;
  }

  Element source_;
  const Parameters* parameters_;
  const BehaviourNames& names_;
  std::vector<LinearForm> variables_;
  std::vector<Element> made_;
  std::string text_;
  std::size_t at_ = 0;
  int depth_ = 0;
};

}  // namespace

std::vector<Element> behavioural_source(Element source, const std::string& expression, const Parameters& parameters,
                                        const BehaviourNames& names) {
  return Behaviour(std::move(source), parameters, names).read(expression);
}

}  // namespace bromwich::circuits
