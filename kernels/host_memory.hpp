#pragma once
// Memory of the host that a device reads and writes: small pinned pieces, and the way of large arrays to memory that is
// not pinned.

#include "core/base/types.hpp"
#include "kernels/helpers.hpp"

#include <cuda_runtime.h>

#include <cstddef>
#include <functional>
#include <vector>

namespace bromwich::cuda {

/// Small pieces of pinned memory, which the driver takes long to give and to take back: handed out again and again.
class PinnedSlots {
 public:
  static constexpr std::size_t slot_bytes = 128;
  PinnedSlots() = default;
  ~PinnedSlots();
  PinnedSlots(const PinnedSlots&) = delete;
  PinnedSlots& operator=(const PinnedSlots&) = delete;

  void* take();
  /// Nothing may be under way that writes to it.
  void give_back(void* slot) { free_.push_back(slot); }

 private:
  std::vector<void*> pages_, free_;
};

/// Copies arrays to memory of the host that is not pinned, through a ring of pinned pieces that several threads empty
/// while the next ones arrive.
class Fetcher {
 public:
  explicit Fetcher(int device);
  ~Fetcher();
  Fetcher(const Fetcher&) = delete;
  Fetcher& operator=(const Fetcher&) = delete;

  /// `rows` rows of `cols` values, `step` apart on the device and without gaps on the host, after what `stream` has
  /// been asked for so far. `meanwhile` is called once while they are on their way.
  void fetch(const double* from, std::size_t step, double* to, std::size_t cols, std::size_t rows, cudaStream_t stream,
             const std::function<void()>& meanwhile);
  /// The other way: `count` values, which may change once this returns. Later work on `stream` waits for them.
  void send(const double* from, std::size_t count, double* to, cudaStream_t stream);
  /// See HostThreads::each_range. Threads that sleep, since those of OpenMP stay awake for a while behind a loop, and
  /// are in the way of what is fetched next.
  void each_range(Index count, Index length, const std::function<void(Index first, Index last)>& body);

 private:
  struct Busy {
    explicit Busy(bool& flag) : flag(flag) { flag = true; }
    ~Busy() { flag = false; }
    bool& flag;
  };

  void make();

  int device_;
  bool busy_ = false;  ///< `meanwhile` may fetch another array, not through the ring then; a range may ask for ranges
  Helpers helpers_;
  cudaStream_t stream_ = nullptr;
  double* ring_ = nullptr;
  cudaEvent_t ready_ = nullptr;
  cudaEvent_t sent_ = nullptr;       ///< behind the last piece that left the ring
  std::vector<cudaEvent_t> copied_;  ///< one a slot of the ring
};

}  // namespace bromwich::cuda
