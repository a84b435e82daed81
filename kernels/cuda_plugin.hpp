#pragma once
// The CUDA backend in a shared object of its own, loaded when it is needed: a program that may use a device starts and
// runs where no CUDA library is. Both sides have a copy of core; backends and exceptions pass between them, so both
// have to be of one build.

#include "kernels/ceilings.hpp"
#include "kernels/cuda_backend.hpp"

#include <memory>
#include <string>
#include <vector>

namespace bromwich {

/// What the shared object offers: the functions of cuda_backend.hpp and ceilings.hpp.
struct CudaPlugin {
  std::vector<std::string> (*devices)();
  std::unique_ptr<Backend> (*make)(std::unique_ptr<Backend> host, int device);
  CudaCeilings (*ceilings)();
  CudaTransformSeconds (*transform_seconds)(Index n, Index rows);
};

/// Version, compiler and layout; equal on both sides.
std::string cuda_plugin_abi();

/// Name of the function that the shared object exports: its table if `abi` is its own, otherwise null.
inline constexpr const char* cuda_plugin_symbol = "bromwich_cuda_plugin";
using CudaPluginEntry = const CudaPlugin* (*)(const char* abi);

/// File of the shared object, before the first call of cuda_devices. Empty: there is none.
void set_cuda_plugin(const std::string& file);

/// Why there is no CUDA backend, in one line; empty if it is loaded.
std::string cuda_plugin_missing();

}  // namespace bromwich
