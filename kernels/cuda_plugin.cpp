// The entry of the shared object.

#include "kernels/cuda_plugin.hpp"

extern "C" __attribute__((visibility("default"))) const bromwich::CudaPlugin* bromwich_cuda_plugin(const char* abi) {
  static const bromwich::CudaPlugin plugin{bromwich::cuda_devices, bromwich::make_cuda_backend, bromwich::cuda_ceilings,
                                           bromwich::cuda_transform_seconds};
  return bromwich::cuda_plugin_abi() == abi ? &plugin : nullptr;
}
