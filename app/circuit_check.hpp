#pragma once
// What `bromwich check` says of the reduction of a netlist.

#include "app/output_json.hpp"
#include "circuits/circuit.hpp"

#include <string>
#include <utility>
#include <vector>

namespace bromwich::app {

/// Lines of text, (label, fact).
std::vector<std::pair<std::string, std::string>> circuit_facts(const Circuit&);

/// Lists of names and equations by their kind: states, pairs, loops, cutsets, windings, open.
Json circuit_json(const Circuit&);

}  // namespace bromwich::app
