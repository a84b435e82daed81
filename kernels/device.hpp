#pragma once
// CUDA errors, memory and the stream of a backend. Operations are enqueued on one stream and return before they finish.
// Functions that return values to the host wait.

#include "core/seam/backend.hpp"
#include "kernels/host_memory.hpp"
#include "kernels/recycling.hpp"

#include <cuda_runtime.h>

#include <cstddef>
#include <map>
#include <memory>
#include <new>
#include <optional>
#include <typeindex>
#include <utility>

namespace bromwich::cuda {

/// Throws Error("cuda", ...) with the message of the runtime.
void check(cudaError_t status, const char* what);

/// The stream, the memory pool and the caches shared by all plans of a backend.
class Device {
 public:
  explicit Device(int number);
  ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  /// Also makes this the device of the calling thread, as all that follows needs: CUDA keeps one for each thread.
  cudaStream_t stream() const {
    use();
    return stream_;
  }
  void wait() const { check(cudaStreamSynchronize(stream_), "waiting for the device"); }
  int multiprocessors() const { return multiprocessors_; }
  std::size_t shared_memory() const { return std::size_t(shared_memory_); }  ///< bytes available to a block
  /// Whether the next kernel on the stream may begin before the previous one ends (kernels/launch.cuh): the device
  /// supports it, and in a stream capture exactly one kernel precedes it.
  bool may_overlap() const;
  /// Whether blocks of a kernel may work together as clusters.
  bool has_clusters() const { return major_ >= 9; }
  PinnedSlots& pinned() const { return pinned_; }
  Fetcher& fetcher() const { return fetcher_; }
  BlockCache& blocks() const {
    use();
    return *blocks_;
  }
  SideStreams& side_streams() const { return side_streams_; }
  RetiredGraphs& retired_graphs() const { return retired_graphs_; }

  /// Call before work that may change the counters of plans.
  void note_work() const { ++work_; }
  unsigned long work() const { return work_; }

  /// A T shared by plans of this device: the last one made if it `fits`, otherwise the result of `make`, which replaces
  /// it.
  template <class T, class Fits, class Make>
  std::shared_ptr<T> shared(Fits fits, Make make) const {
    use();
    std::shared_ptr<void>& kept = kept_[typeid(T)];
    if (!kept || !fits(*static_cast<T*>(kept.get()))) kept = make();
    return std::static_pointer_cast<T>(kept);
  }

 private:
  void use() const;

  int number_;
  cudaStream_t stream_ = nullptr;
  int multiprocessors_ = 1, shared_memory_ = 0, major_ = 0;
  mutable unsigned long work_ = 0;
  mutable PinnedSlots pinned_;
  mutable Fetcher fetcher_;
  mutable std::optional<BlockCache> blocks_;
  mutable SideStreams side_streams_;
  mutable RetiredGraphs retired_graphs_;
  mutable std::map<std::type_index, std::shared_ptr<void>> kept_;
};

/// A T in pinned host memory.
template <class T>
class Pinned {
 public:
  static_assert(sizeof(T) <= PinnedSlots::slot_bytes);
  Pinned(const Device& device, const T& value) : device_(device), value_(new (device.pinned().take()) T(value)) {}
  ~Pinned() {
    cudaStreamSynchronize(device_.stream());
    device_.pinned().give_back(value_);
  }
  Pinned(const Pinned&) = delete;
  Pinned& operator=(const Pinned&) = delete;

  T* get() const { return value_; }
  T* operator->() const { return value_; }
  T& operator*() const { return *value_; }

 private:
  const Device& device_;
  T* value_;
};

/// `size` values of T on the device, not initialised.
template <class T>
class Memory {
 public:
  Memory() = default;
  Memory(const Device& device, std::size_t size) : device_(&device), size_(size) {
    if (size_ > 0) block_ = device.blocks().take(bytes());
  }
  Memory(Memory&& other) noexcept { swap(other); }
  Memory& operator=(Memory&& other) noexcept {
    swap(other);
    return *this;
  }
  ~Memory() {
    if (block_.data) device_->blocks().give_back(block_);
  }

  T* data() { return static_cast<T*>(block_.data); }
  const T* data() const { return static_cast<const T*>(block_.data); }
  std::size_t size() const { return size_; }
  std::size_t bytes() const { return size_ * sizeof(T); }

  void clear() {
    if (size_ > 0) check(cudaMemsetAsync(data(), 0, bytes(), device_->stream()), "clearing device memory");
  }
  /// Copies from the host. The source may change after the call.
  void put(const T* from) {
    if (size_ == 0) return;
    check(cudaMemcpyAsync(data(), from, bytes(), cudaMemcpyHostToDevice, device_->stream()), "copying to the device");
    device_->wait();
  }
  void get(T* to) const {
    if (size_ == 0) return;
    check(cudaMemcpyAsync(to, data(), bytes(), cudaMemcpyDeviceToHost, device_->stream()), "copying from the device");
    device_->wait();
  }

 private:
  void swap(Memory& other) {
    std::swap(device_, other.device_);
    std::swap(block_, other.block_);
    std::swap(size_, other.size_);
  }

  const Device* device_ = nullptr;
  BlockCache::Block block_;
  std::size_t size_ = 0;
};

/// Distance in values between rows of an array. Except for short rows, it aligns rows for tensor cores and wide loads.
/// The padding is zero and stays zero.
inline Index stride(Index cols) { return cols < 16 ? cols : (cols + 7) / 8 * 8; }

class DeviceArray final : public Array {
 public:
  DeviceArray(const Device& device, Index rows, Index cols)
      : Array(rows, cols), memory(device, std::size_t(rows * stride(cols))) {
    memory.clear();
  }

  Memory<double> memory;
};

inline const double* values(const Array& array) { return static_cast<const DeviceArray&>(array).memory.data(); }
inline double* values(Array& array) { return static_cast<DeviceArray&>(array).memory.data(); }

/// Copies a host matrix to the device in its own storage order.
template <class Derived>
Memory<double> on_device(const Device& device, const Eigen::PlainObjectBase<Derived>& matrix) {
  Memory<double> memory(device, std::size_t(matrix.size()));
  memory.put(matrix.data());
  return memory;
}

}  // namespace bromwich::cuda
