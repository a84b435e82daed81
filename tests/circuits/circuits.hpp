#pragma once
// Netlists of the tests.

#include "circuits/circuit.hpp"

#include <string>

namespace bromwich::test {

/// Cards behind a title line.
inline Circuit circuit_of(const std::string& cards) { return parse_circuit("title\n" + cards, "test.cir"); }

/// What a refused netlist is told, or "".
inline std::string message_of(const std::string& cards) {
  try {
    circuit_of(cards);
    return "";
  } catch (const std::exception& error) {
    return error.what();
  }
}

}  // namespace bromwich::test
