#include "files/nonlinear_section.hpp"

#include "core/base/error.hpp"
#include "files/state_functions.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace bromwich {

namespace {

/// In phi and gamma x1 is the second state, whatever the first one is called.
void check_names(const Sections& s, const Labels& names) {
  for (const auto& [key, list] : {std::pair("x", &names.x), {"y", &names.y}})
    for (std::size_t i = 0; i < list->size(); ++i) {
      const std::string &name = (*list)[i], number = name.substr(std::min<std::size_t>(1, name.size()));
      const bool numbered = name.starts_with(key) && parse_integer(number);
      if (numbered && name != key + std::to_string(i))
        throw Error(s.names.where(key), fmt::format("found '{}' for component {} beside [nonlinear]", name, i),
                    fmt::format("choose another name: in phi and gamma {} is component {}", name, number));
    }
}

}  // namespace

std::optional<NonlinearScene> read_nonlinear(const Sections& s, const Scene& linear) {
  const Section& section = s.nonlinear;
  if (!section.given()) return std::nullopt;
  check_names(s, linear.names);
  if (!section.has("phi") && !section.has("gamma"))
    throw Error(section.where("phi"), "found neither phi nor gamma", "give one of them or both");
  NonlinearScene system;
  system.linear = linear;
  system.of_trace = section.word("of", {"state", "trace"}) == "trace";
  const char letter = system.of_trace ? 'v' : 'x';
  const auto variables = variables_of(letter, system.seen(), linear.names.x, linear.constraints(), linear.names.y);
  const auto read = [&](const char* key, Index size, NonlinearFunction& value, NonlinearDerivative& derivative) {
    if (!section.has(key)) return;
    StateFunctions functions = state_functions(section.formulas(key, size, variables, {letter, 'y'}), system.seen());
    value = std::move(functions.value);
    derivative = std::move(functions.derivative);
  };
  read("phi", system.seen(), system.phi, system.dphi);
  read("gamma", linear.constraints(), system.gamma, system.dgamma);
  const auto in_section = [&] {
    Places where = places(s);
    where["dynamics"] = where["boundary"] = where["phi"] = section.where("phi");
    return where;
  };
  in_the_file(in_section, [&] { system.validate(); });
  return system;
}

}  // namespace bromwich
