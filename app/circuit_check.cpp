#include "app/circuit_check.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace bromwich::app {

namespace {

constexpr std::size_t most_names = 12;

// Names, and how many more there are.
std::string few(const std::vector<std::string>& names) {
  const auto end = names.begin() + long(std::min(names.size(), most_names));
  std::string text = fmt::format("{}", fmt::join(names.begin(), end, ", "));
  if (names.size() > most_names) text += fmt::format(", ... ({} more)", names.size() - most_names);
  return text;
}

}  // namespace

std::vector<std::pair<std::string, std::string>> circuit_facts(const Circuit& circuit) {
  const CircuitReduction& r = circuit.reduction;
  std::vector<std::pair<std::string, std::string>> facts{{"netlist", r.summary}};
  for (const auto& [label, names] : {std::pair("states", &r.states), {"pairs", &r.pairs}, {"open", &r.open}})
    if (!names->empty()) facts.emplace_back(label, few(*names));
  for (const auto& [label, equations] : {std::pair("loop", &r.loops), {"cutset", &r.cutsets}, {"winding", &r.windings}})
    for (std::size_t k = 0; k < equations->size(); ++k) {
      if (k == most_names) {
        facts.emplace_back("", fmt::format("... ({} more)", equations->size() - most_names));
        break;
      }
      facts.emplace_back(label, (*equations)[k]);
    }
  return facts;
}

Json circuit_json(const Circuit& circuit) {
  const CircuitReduction& r = circuit.reduction;
  return {{"states", r.states}, {"pairs", r.pairs},     {"open", r.open},
          {"loops", r.loops},   {"cutsets", r.cutsets}, {"windings", r.windings}};
}

}  // namespace bromwich::app
