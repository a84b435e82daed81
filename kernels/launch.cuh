#pragma once
// Overlapping launches (programmatic dependent launch, compute capability 9.0): the blocks of a kernel start, and do
// the work that does not depend on earlier kernels, while the previous kernel still runs.
//
// A kernel launched by `follow` may begin once all blocks of the previous kernel have called `let_next_begin` or ended.
// Its threads must call `await_previous` before they read or write anything that other kernels write. Blocks without
// work may return at once if others of the same launch wait. The wait covers the previous kernel and its writes. As
// that one awaited its own predecessor, all earlier kernels have ended too; a kernel in which no thread waits would
// break this for all later ones. Copies, memsets, events and kernels launched with <<<>>> wait for everything before
// them, and nothing after them begins early.
//
// Tables may be read at any time if the host has waited for them before the launch. Memory that other kernels write
// must not be const __restrict__: the compiler may move such loads before the wait.

#include "kernels/device.hpp"

#include <type_traits>

namespace bromwich::cuda {

inline constexpr bool overlaps = true;  ///< false: each kernel begins after the previous one has ended

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

/// Launch configuration: blocks, threads per block, bytes of dynamic shared memory, and blocks of a cluster, which all
/// have the same blockIdx.x (compute capability 9.0; 1: no clusters).
struct Blocks {
  dim3 count, threads;
  std::size_t shared = 0;
  unsigned cluster = 1;
};

/// Launches the kernel on the stream of the device, overlapping the previous one as described above if possible. Throws
/// Error("cuda", ...) that names `what`.
template <class... Parameters>
void follow(const Device& device, void (*kernel)(Parameters...), const Blocks& blocks, const char* what,
            std::type_identity_t<Parameters>... arguments) {
  cudaLaunchAttribute attributes[2];
  cudaLaunchConfig_t configuration{};
  configuration.gridDim = blocks.count;
  configuration.blockDim = blocks.threads;
  configuration.dynamicSmemBytes = blocks.shared;
  configuration.stream = device.stream();
  configuration.attrs = attributes;
  if (overlaps && device.may_overlap()) {
    cudaLaunchAttribute& overlapped = attributes[configuration.numAttrs++];
    overlapped.id = cudaLaunchAttributeProgrammaticStreamSerialization;
    overlapped.val.programmaticStreamSerializationAllowed = 1;
  }
  if (blocks.cluster > 1) {
    cudaLaunchAttribute& together = attributes[configuration.numAttrs++];
    together.id = cudaLaunchAttributeClusterDimension;
    together.val.clusterDim = {1, blocks.cluster, 1};
  }
  device.note_work();
  check(cudaLaunchKernelEx(&configuration, kernel, arguments...), what);
}

}  // namespace bromwich::cuda
