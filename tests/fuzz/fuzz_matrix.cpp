// Matrices in the format of Matrix Market.

#include "files/number_files.hpp"
#include "tests/fuzz/read.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return bromwich::fuzz::accepts(
      [&] { bromwich::read_matrix_market(std::string(bromwich::fuzz::text(data, size)), "fuzz.mtx"); });
}
