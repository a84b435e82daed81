#pragma once
// Memory of the host that a device reads and writes: small pinned pieces, and the way of large arrays to memory that is
// not pinned.

#include <cuda_runtime.h>

#include <cstddef>
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

/// All `count` values at `to`, by several threads where they are many.
void fill(double* to, std::size_t count, double value);

/// Copies large arrays to memory of the host that is not pinned: threads with a stream and a pinned buffer each fetch
/// pieces of whole rows.
class Fetchers {
 public:
  explicit Fetchers(int device) : device_(device) {}
  ~Fetchers();
  Fetchers(const Fetchers&) = delete;
  Fetchers& operator=(const Fetchers&) = delete;

  /// `rows` rows of `width` bytes, `pitch` apart on the device and without gaps on the host, after what `stream` has
  /// been asked for.
  void fetch(const void* from, std::size_t pitch, void* to, std::size_t width, std::size_t rows, cudaStream_t stream);

 private:
  struct Fetcher {
    cudaStream_t stream = nullptr;
    void* buffer = nullptr;  ///< two halves: one is filled while the other is read
    cudaEvent_t copied[2] = {};
  };
  void make();

  int device_;
  cudaEvent_t ready_ = nullptr;
  std::vector<Fetcher> fetchers_;
};

}  // namespace bromwich::cuda
