#pragma once
// Kernels that follow each other in a stream without a gap: the blocks of one come to their multiprocessors, and do
// what does not depend on the kernels before, while those still run (programmatic dependent launch, compute capability
// 9.0).
//
// A kernel that `follow` starts may begin as soon as all blocks of the one before have called `let_next_begin` or
// ended. Its threads have to call `await_previous` before they read or write anything that other kernels write; blocks
// without work may return at once, where others of the same launch do wait. That waits for the end of the one kernel
// before, and for what it wrote. Since that one awaited its own predecessor before it ended, everything further back
// has ended too; a kernel in which nobody waits would break this for all behind it. Copies, memsets, events and kernels
// that are started with <<<>>> wait for the end of what is before them, and let nothing begin before their own.
//
// Tables that are complete before a kernel that reads them is started, since the host has waited for them, may be read
// at any time. What other kernels write must not be const __restrict__: such loads may be moved to before the wait.

#include "kernels/device.hpp"

#include <type_traits>

namespace bromwich::cuda {

inline constexpr bool overlaps = true;  ///< false: each kernel begins where the one before has ended

__device__ inline void let_next_begin() {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
  if constexpr (overlaps) cudaTriggerProgrammaticLaunchCompletion();
#endif
}

__device__ inline void await_previous() {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
  if constexpr (overlaps) cudaGridDependencySynchronize();
#endif
}

/// Of a launch: its blocks, the threads of each, and their bytes of dynamic shared memory.
struct Blocks {
  dim3 count, threads;
  std::size_t shared = 0;
};

/// Starts the kernel on the stream of the device, behind the kernel before as described above where that is possible.
/// Raises Error("cuda", ...) naming `what`.
template <class... Parameters>
void follow(const Device& device, void (*kernel)(Parameters...), const Blocks& blocks, const char* what,
            std::type_identity_t<Parameters>... arguments) {
  cudaLaunchAttribute overlapped;
  overlapped.id = cudaLaunchAttributeProgrammaticStreamSerialization;
  overlapped.val.programmaticStreamSerializationAllowed = 1;
  cudaLaunchConfig_t configuration{};
  configuration.gridDim = blocks.count;
  configuration.blockDim = blocks.threads;
  configuration.dynamicSmemBytes = blocks.shared;
  configuration.stream = device.stream();
  configuration.attrs = &overlapped;
  configuration.numAttrs = overlaps && device.may_overlap() ? 1 : 0;
  device.note_work();
  check(cudaLaunchKernelEx(&configuration, kernel, arguments...), what);
}

}  // namespace bromwich::cuda
