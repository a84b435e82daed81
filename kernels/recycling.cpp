#include "kernels/recycling.hpp"

#include "kernels/device.hpp"

namespace bromwich::cuda {

BlockCache::Block BlockCache::take(std::size_t bytes) {
  const std::size_t wanted = (bytes + granule - 1) / granule * granule;
  if (const auto found = blocks_.lower_bound(wanted); found != blocks_.end() && found->first <= wanted + wanted / 4) {
    const Block block{found->second, found->first};
    blocks_.erase(found);
    kept_ -= block.bytes;
    return block;
  }
  Block block{nullptr, wanted};
  cudaError_t status = cudaMallocAsync(&block.data, wanted, stream_);
  if (status == cudaErrorMemoryAllocation && kept_ > 0) {
    cudaGetLastError();
    clear();
    status = cudaMallocAsync(&block.data, wanted, stream_);
  }
  check(status, "allocating device memory");
  return block;
}

void BlockCache::give_back(const Block& block) {
  if (kept_ + block.bytes > most_kept) {
    cudaFreeAsync(block.data, stream_);
    return;
  }
  blocks_.emplace(block.bytes, block.data);
  kept_ += block.bytes;
}

void BlockCache::clear() {
  for (const auto& [bytes, data] : blocks_) cudaFreeAsync(data, stream_);
  blocks_.clear();
  kept_ = 0;
}

SideStreams::~SideStreams() {
  for (const SideStream& side : free_) {
    cudaEventDestroy(side.begun);
    cudaEventDestroy(side.ended);
    cudaStreamDestroy(side.stream);
  }
}

SideStream SideStreams::take() {
  SideStream side;
  if (free_.empty()) {
    check(cudaStreamCreateWithFlags(&side.stream, cudaStreamNonBlocking), "making a stream");
    for (cudaEvent_t* event : {&side.begun, &side.ended})
      check(cudaEventCreateWithFlags(event, cudaEventDisableTiming), "making an event");
    return side;
  }
  side = free_.back();
  free_.pop_back();
  return side;
}

void RetiredGraphs::destroy() {
  for (const cudaGraphExec_t graph : graphs_) cudaGraphExecDestroy(graph);
  graphs_.clear();
}

}  // namespace bromwich::cuda
