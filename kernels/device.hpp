#pragma once
// CUDA errors, memory and the stream of a backend. Every operation is put on one stream and returns before it has
// finished; what needs a result on the host waits.

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

/// Throws Error("cuda", ...) with what the runtime says.
void check(cudaError_t status, const char* what);

/// The stream and the memory pool that everything of one backend shares.
class Device {
 public:
  explicit Device(int number);
  ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  cudaStream_t stream() const { return stream_; }
  void wait() const { check(cudaStreamSynchronize(stream_), "waiting for the device"); }
  int multiprocessors() const { return multiprocessors_; }
  std::size_t shared_memory() const { return std::size_t(shared_memory_); }  ///< bytes a block may have
  /// Whether the kernel that is started next on the stream may begin while the one before ends (kernels/launch.cuh):
  /// the device knows how to, and a recording has exactly one kernel before it.
  bool may_overlap() const;
  PinnedSlots& pinned() const { return pinned_; }
  Fetcher& fetcher() const { return fetcher_; }
  BlockCache& blocks() const { return *blocks_; }
  SideStreams& side_streams() const { return side_streams_; }
  RetiredGraphs& retired_graphs() const { return retired_graphs_; }

  /// Counts what is started that may change what plans have counted.
  void note_work() const { ++work_; }
  unsigned long work() const { return work_; }

  /// The T that plans of this device share: the one made last, if `fits` it; otherwise what `make` makes. It stays
  /// until another takes its place.
  template <class T, class Fits, class Make>
  std::shared_ptr<T> shared(Fits fits, Make make) const {
    std::shared_ptr<void>& kept = kept_[typeid(T)];
    if (!kept || !fits(*static_cast<T*>(kept.get()))) kept = make();
    return std::static_pointer_cast<T>(kept);
  }

 private:
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

/// A T in pinned memory of the host.
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

/// `size` values of T on the device; not initialised.
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
  /// From the host; the source may change once this returns.
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

/// Values from one row of an array to the next: rows begin at cache lines, which tensor cores and wide loads want, but
/// for short ones. What lies between is zero and stays zero.
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

/// A matrix of the host on the device, in its own storage order.
template <class Derived>
Memory<double> on_device(const Device& device, const Eigen::PlainObjectBase<Derived>& matrix) {
  Memory<double> memory(device, std::size_t(matrix.size()));
  memory.put(matrix.data());
  return memory;
}

}  // namespace bromwich::cuda
