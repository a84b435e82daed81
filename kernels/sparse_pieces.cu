// A warp packs a segment: eight times 32 neighbouring values, each time those that are not zero behind the others.

#include "kernels/sparse_pieces.hpp"

#include "kernels/device.hpp"

namespace bromwich::cuda {

namespace {

constexpr int lanes = 32, warps = 8;  ///< of a block
constexpr int rounds = int(segment_values) / lanes;

__global__ void __launch_bounds__(lanes* warps)
    pack(const double* from, std::size_t count, double* packed, std::uint32_t* masks) {
  const int lane = int(threadIdx.x) % lanes;
  const std::size_t segment = std::size_t(blockIdx.x) * warps + threadIdx.x / lanes;
  const std::size_t begin = segment * segment_values;
  if (begin >= count) return;
  double values[rounds];
#pragma unroll
  for (int k = 0; k < rounds; ++k) {
    const std::size_t at = begin + std::size_t(k * lanes + lane);
    values[k] = at < count ? from[at] : 0;
  }
  double* const to = packed + begin;
  int before = 0;
  unsigned mine = 0;
#pragma unroll
  for (int k = 0; k < rounds; ++k) {
    const bool there = __double_as_longlong(values[k]) != 0;
    const unsigned mask = __ballot_sync(~0u, there);
    if (there) to[before + __popc(mask & ((1u << lane) - 1))] = values[k];
    before += __popc(mask);
    if (lane == k) mine = mask;
  }
  if (lane < rounds) masks[segment * rounds + std::size_t(lane)] = mine;
}

}  // namespace

void pack_segments(const double* from, std::size_t count, double* packed, std::uint64_t* masks, cudaStream_t stream) {
  const unsigned blocks = unsigned((segments_of(count) + warps - 1) / warps);
  pack<<<blocks, lanes * warps, 0, stream>>>(from, count, packed, reinterpret_cast<std::uint32_t*>(masks));
  check(cudaGetLastError(), "packing rows");
}

}  // namespace bromwich::cuda
