#pragma once
// Packs arrays with many zeros into the segments of kernels/unpacking.hpp. Zero: all bits of a value are.

#include "kernels/unpacking.hpp"

#include <cuda_runtime.h>

namespace bromwich::cuda {

/// Packs `count` values of the device into memory that it may write, pinned on the host.
void pack_segments(const double* from, std::size_t count, double* packed, std::uint64_t* masks, cudaStream_t stream);

}  // namespace bromwich::cuda
