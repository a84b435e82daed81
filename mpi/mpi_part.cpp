// The entry of the shared object.

#include "files/loaded_part.hpp"
#include "mpi/mpi_job.hpp"

extern "C" __attribute__((visibility("default"))) const void* bromwich_part(const char* abi) {
  static const bromwich::MpiPart part{bromwich::join_mpi};
  return bromwich::part_abi() == abi ? &part : nullptr;
}
