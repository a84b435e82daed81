// The entry of the shared object.

#include "files/hdf5_part.hpp"

#include "files/loaded_part.hpp"

extern "C" __attribute__((visibility("default"))) const void* bromwich_part(const char* abi) {
  using namespace bromwich;
  static const Hdf5Part part{create_hdf5,     continue_hdf5, create_vtkhdf,    continue_vtkhdf, create_sweep_hdf5,
                             read_sweep_hdf5, read_hdf5,     write_checkpoint, read_checkpoint};
  return part_abi() == abi ? &part : nullptr;
}
