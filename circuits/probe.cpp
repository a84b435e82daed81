#include "circuits/probe.hpp"

#include "circuits/values.hpp"
#include "core/base/error.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

namespace bromwich {

namespace {

using circuits::lower;

bool of_name(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '.'; }

std::string trimmed(const std::string& s) {
  const std::size_t first = s.find_first_not_of(" \t"), last = s.find_last_not_of(" \t");
  return first == std::string::npos ? "" : s.substr(first, last - first + 1);
}

/// What stands in the parentheses that `open` is the first of, at commas; `end`: behind them.
std::vector<std::string> names_in(const std::string& text, std::size_t open, std::size_t& end,
                                  const std::string& where) {
  end = text.find(')', open);
  if (end == std::string::npos) throw Error(where, fmt::format("'{}' has a '(' without ')'", text), "close it");
  std::vector<std::string> names(1);
  for (std::size_t i = open + 1; i < end; ++i)
    if (text[i] == ',')
      names.emplace_back();
    else
      names.back() += text[i];
  for (std::string& name : names) name = lower(trimmed(name));
  ++end;
  return names;
}

struct TermValues {
  double t;
  const std::vector<double>& of_terms;
  double constant(double v) const { return v; }
  double time() const { return t; }
  double variable(std::size_t number) const { return of_terms[number]; }
  static bool zero(double v) { return v == 0; }
  static std::optional<double> apply(Operation operation, double a, double b) {
    return takes_two(operation) ? bromwich::apply(operation, a, b) : bromwich::apply(operation, a);
  }
};

Index output_named(const Circuit& c, const std::string& name) {
  const std::string wanted = lower(name);
  for (std::size_t i = 0; i < c.outputs.size(); ++i)
    if (lower(c.outputs[i].name) == wanted) return Index(i);
  return -1;
}

}  // namespace

Probe::Term Probe::term(const Circuit& c, char kind, const std::vector<std::string>& names,
                        const std::string& where) const {
  std::vector<std::string> known;
  const auto output = [&](char letter, const std::string& name) {
    const Index found = output_named(c, fmt::format("{}({})", letter, name));
    if (found >= 0) return found;
    for (const CircuitOutput& o : c.outputs)
      if (o.name[0] == letter) known.push_back(o.name.substr(2, o.name.size() - 3));
    throw Error(
        where,
        fmt::format("'{}' has no {} '{}'", text_, letter == 'V' ? "node" : "element", name) + suggestion(name, known),
        "use names of the netlist");
  };
  const auto node = [&](const std::string& name) { return name == "0" || name == "gnd" ? -1 : output('V', name); };
  if (names.size() > (kind == 'v' ? 2u : 1u) || names[0].empty())
    throw Error(where, fmt::format("found '{}'", text_), "write V(node), V(node, node), I(element) or P(element)");
  if (kind == 'v') return {kind, node(names[0]), names.size() == 2 ? node(names[1]) : -1, -1};
  Term t{kind, -1, -1, output('I', names[0])};
  if (kind == 'i') return t;
  for (const CircuitElement& e : c.elements)
    if (e.current == t.current) t.from = e.from, t.to = e.to;
  return t;
}

Probe::Probe(const Circuit& c, const std::string& text, const std::string& where) : text_(text) {
  std::string plain, kinds;
  std::map<std::string, std::size_t> variables;
  for (std::size_t i = 0; i < text.size();) {
    const char kind = char(std::tolower(static_cast<unsigned char>(text[i])));
    const bool begins = i == 0 || !of_name(text[i - 1]);
    const std::size_t open = text.find_first_not_of(' ', i + 1);
    if (begins && (kind == 'v' || kind == 'i' || kind == 'p') && open != std::string::npos && text[open] == '(') {
      const std::size_t begin = i;
      const std::vector<std::string> names = names_in(text, open, i, where);
      terms_.push_back(term(c, kind, names, where));
      label_ += names.size() == 2 ? fmt::format("V({})-V({})", names[0], names[1]) : text.substr(begin, i - begin);
      const std::string name = fmt::format("probe_{}", terms_.size());
      variables[name] = terms_.size() - 1;
      plain += name;
      kinds += kind;
    } else {
      label_ += text[i];
      plain += text[i++];
    }
  }
  circuits::Parameters parameters;
  for (const auto& [name, value] : c.parameters) parameters.set(name, value);
  parameters.define("time", "t", {where});
  plain = parameters.plain(lower(plain), {where});
  formula_ = read_formula(plain, {}, where, variables);
  const bool sum = plain.find_first_of("*/^<>?") == std::string::npos;
  if (!kinds.empty() && sum && kinds.find_first_not_of(kinds[0]) == std::string::npos)
    unit_ = kinds[0] == 'v' ? "V" : kinds[0] == 'i' ? "A" : "W";
  else if (kinds.size() == 2 && kinds[0] != kinds[1] && kinds.find('p') == std::string::npos &&
           std::count(plain.begin(), plain.end(), '*') == 1 && plain.find_first_of("/^<>?+") == std::string::npos)
    unit_ = "W";
}

Probe::Probe(const Circuit&, char kind, const CircuitElement& e)
    : text_(fmt::format("{}({})", kind, e.name)),
      label_(text_),
      unit_(kind == 'V'   ? "V"
            : kind == 'I' ? "A"
                          : "W"),
      terms_{{char(std::tolower(static_cast<unsigned char>(kind))), e.from, e.to, e.current}},
      formula_(read_formula("probe_1", {}, text_, {{"probe_1", 0}})) {}

Vector Probe::operator()(const Vector& t, const RowMatrix& outputs) const {
  Vector found(t.size());
  std::vector<double> of_terms(terms_.size()), stack;
  for (Index j = 0; j < t.size(); ++j) {
    for (std::size_t k = 0; k < terms_.size(); ++k) {
      const Term& one = terms_[k];
      const double v = (one.from < 0 ? 0 : outputs(j, one.from)) - (one.to < 0 ? 0 : outputs(j, one.to));
      of_terms[k] = one.kind == 'v' ? v : outputs(j, one.current) * (one.kind == 'p' ? v : 1);
    }
    TermValues domain{t[j], of_terms};
    found[j] = execute(formula_, domain, stack).value_or(NAN);
  }
  return found;
}

}  // namespace bromwich
