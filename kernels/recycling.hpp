#pragma once
// What a driver takes long to give and to take back, kept for the plans that are made next.

#include <cuda_runtime.h>

#include <cstddef>
#include <map>
#include <vector>

namespace bromwich::cuda {

/// Blocks of device memory. All are used in the order of one stream, so that one which is given back may be taken at
/// once.
class BlockCache {
 public:
  struct Block {
    void* data = nullptr;
    std::size_t bytes = 0;  ///< at least what was asked for, and at most a quarter more
  };

  explicit BlockCache(cudaStream_t stream) : stream_(stream) {}
  ~BlockCache() { clear(); }
  BlockCache(const BlockCache&) = delete;
  BlockCache& operator=(const BlockCache&) = delete;

  /// Raises Error("cuda", ...) where there is no memory, after everything kept has gone back.
  Block take(std::size_t bytes);
  void give_back(const Block&);
  void clear();
  std::size_t kept() const { return kept_; }  ///< bytes

 private:
  static constexpr std::size_t most_kept = std::size_t(1) << 30;  ///< bytes
  static constexpr std::size_t granule = 512;                     ///< bytes

  cudaStream_t stream_;
  std::multimap<std::size_t, void*> blocks_;
  std::size_t kept_ = 0;
};

/// A stream beside that of the device, and events to begin it behind that one and to end it before what follows there.
struct SideStream {
  cudaStream_t stream = nullptr;
  cudaEvent_t begun = nullptr, ended = nullptr;
};

class SideStreams {
 public:
  SideStreams() = default;
  ~SideStreams();
  SideStreams(const SideStreams&) = delete;
  SideStreams& operator=(const SideStreams&) = delete;

  SideStream take();
  /// What it was asked for has to be awaited by the stream of the device.
  void give_back(const SideStream& side) { free_.push_back(side); }

 private:
  std::vector<SideStream> free_;
};

/// Graphs that nobody starts any more: destroyed when the next one is made, or at the end.
class RetiredGraphs {
 public:
  RetiredGraphs() = default;
  ~RetiredGraphs() { destroy(); }
  RetiredGraphs(const RetiredGraphs&) = delete;
  RetiredGraphs& operator=(const RetiredGraphs&) = delete;

  void add(cudaGraphExec_t graph) { graphs_.push_back(graph); }
  void destroy();

 private:
  std::vector<cudaGraphExec_t> graphs_;
};

}  // namespace bromwich::cuda
