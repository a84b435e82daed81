// Results in files of HDF5.

#include "files/stored_result.hpp"
#include "tests/fuzz/read.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return bromwich::fuzz::accepts([&] { bromwich::read_hdf5({"FILE", bromwich::fuzz::file_of(data, size, ".h5")}); });
}
