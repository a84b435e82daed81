#include "files/nonlinear_section.hpp"

#include "core/base/error.hpp"
#include "files/state_functions.hpp"

namespace bromwich {

std::optional<NonlinearScene> read_nonlinear(const Sections& s, const Scene& linear) {
  const Section& section = s.nonlinear;
  if (!section.given()) return std::nullopt;
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
