#pragma once
// Resources that the driver allocates and frees slowly, kept for later plans.

#include <cuda_runtime.h>

#include <cstddef>
#include <map>
#include <vector>

namespace bromwich::cuda {

/// Blocks of device memory. All are used in order on one stream, so a returned block can be reused at once.
class BlockCache {
 public:
  struct Block {
    void* data = nullptr;
    std::size_t bytes = 0;  ///< at least the requested size, at most a quarter more
  };

  explicit BlockCache(cudaStream_t stream) : stream_(stream) {}
  ~BlockCache() { clear(); }
  BlockCache(const BlockCache&) = delete;
  BlockCache& operator=(const BlockCache&) = delete;

  /// Frees everything kept and retries if memory is short, then throws Error("cuda", ...).
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

/// A stream beside the main one, with events for fork and join.
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
  /// The main stream must wait for the work of the side stream.
  void give_back(const SideStream& side) { free_.push_back(side); }

 private:
  std::vector<SideStream> free_;
};

/// Graphs out of use, destroyed when the next graph is made or at the end.
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
