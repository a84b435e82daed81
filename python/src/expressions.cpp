#include "files/condition.hpp"
#include "sources.hpp"

#include <nanobind/stl/map.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

namespace bromwich::python {

Source expression_source(const std::vector<std::string>& texts, const std::map<std::string, double>& parameters,
                         double T, const std::string& name) {
  Expressions expressions;
  for (const auto& [key, value] : parameters) expressions.define(key, value, "parameters");
  std::vector<std::string> full;
  for (const std::string& text : texts) full.push_back(expressions.in_full(text, name));
  SwitchTimes switches = expressions.switch_times(full, T);
  return {expressions.in_time(full),
          Index(full.size()),
          std::move(switches.times),
          switches.complete,
          {},
          {},
          [texts, parameters, T, name] { return nb::make_tuple("expressions", texts, parameters, T, name); }};
}

struct ConditionReader::Parts {
  Expressions expressions = {};
  ConditionNames names = {};
  double T = 0;
};

ConditionReader::ConditionReader(Index states, const std::vector<std::string>& x, Index constraints,
                                 const std::vector<std::string>& y, const std::vector<std::string>& memories,
                                 const std::map<std::string, double>& parameters, double T) {
  const auto parts = std::make_shared<Parts>();
  for (const auto& [key, value] : parameters) parts->expressions.define(key, value, "parameters");
  parts->names = {states, x, constraints, y, memories};
  parts->T = T;
  parts_ = parts;
}

ReadCondition ConditionReader::read(const std::string& text, const std::string& name) const {
  SwitchTimes switches;
  Memory::Condition condition = read_condition(text, parts_->names, parts_->expressions, parts_->T, name, switches);
  return {std::move(condition), std::move(switches.times), switches.complete};
}

Index ConditionReader::state(const std::string& name) const {
  const auto known = parts_->names.variables.find(name);
  return known == parts_->names.variables.end() || Index(known->second) >= parts_->names.states ? -1
                                                                                                : Index(known->second);
}

}  // namespace bromwich::python
