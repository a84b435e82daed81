#include "files/expression.hpp"
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

}  // namespace bromwich::python
