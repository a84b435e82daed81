// The entry of the shared object.

#include "files/loaded_part.hpp"
#include "kernels/nccl_communicator.hpp"

extern "C" __attribute__((visibility("default"))) const void* bromwich_part(const char* abi) {
  static const bromwich::NcclPart part{bromwich::make_nccl_communicator};
  return bromwich::part_abi() == abi ? &part : nullptr;
}
