#pragma once
// Host memory that a device reads and writes: small pinned slots, and copies of large arrays to pageable memory.

#include "core/base/types.hpp"
#include "kernels/helpers.hpp"

#include <cuda_runtime.h>

#include <cstddef>
#include <functional>
#include <vector>

namespace bromwich::cuda {

/// Small slots of pinned memory. The driver allocates and frees such memory slowly, so slots are reused.
class PinnedSlots {
 public:
  static constexpr std::size_t slot_bytes = 128;
  PinnedSlots() = default;
  ~PinnedSlots();
  PinnedSlots(const PinnedSlots&) = delete;
  PinnedSlots& operator=(const PinnedSlots&) = delete;

  void* take();
  /// No device operation may still write to the slot.
  void give_back(void* slot) { free_.push_back(slot); }

 private:
  std::vector<void*> pages_, free_;
};

/// Copies arrays to pageable host memory through a ring of pinned pieces, which several threads empty while the next
/// pieces arrive. Of large arrays with many zeros the other values alone cross the bus (kernels/sparse_pieces.hpp).
class Fetcher {
 public:
  explicit Fetcher(int device);
  ~Fetcher();
  Fetcher(const Fetcher&) = delete;
  Fetcher& operator=(const Fetcher&) = delete;

  /// Copies `rows` rows of `cols` values, `step` apart on the device and contiguous on the host, after the operations
  /// enqueued on `stream` so far. Calls `meanwhile` once during the transfer.
  void fetch(const double* from, std::size_t step, double* to, std::size_t cols, std::size_t rows, cudaStream_t stream,
             const std::function<void()>& meanwhile);
  /// Copies `count` values to the device. They may change after the call. Later work on `stream` waits for them.
  void send(const double* from, std::size_t count, double* to, cudaStream_t stream);
  /// See HostThreads::each_range. Uses sleeping threads: OpenMP threads spin after a loop and slow down the next
  /// transfer.
  void each_range(Index count, Index length, const std::function<void(Index first, Index last)>& body);

 private:
  struct Busy {
    explicit Busy(bool& flag) : flag(flag) { flag = true; }
    ~Busy() { flag = false; }
    bool& flag;
  };

  void make();

  int device_;
  bool busy_ = false;  ///< a nested `fetch` or `each_range` does without ring and helpers
  Helpers helpers_;
  cudaStream_t stream_ = nullptr;
  double* ring_ = nullptr;  ///< slots, then the masks of packed pieces
  cudaEvent_t ready_ = nullptr;
  cudaEvent_t sent_ = nullptr;       ///< after the last piece that left the ring
  std::vector<cudaEvent_t> copied_;  ///< one per slot of the ring
};

}  // namespace bromwich::cuda
