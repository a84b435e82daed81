// Netlists in the language of SPICE, with their reduction.

#include "circuits/circuit.hpp"
#include "tests/fuzz/read.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return bromwich::fuzz::accepts(
      [&] { bromwich::parse_circuit(bromwich::fuzz::text(data, size), "fuzz.cir", "/nonexistent"); });
}
