#pragma once
// CUDA errors, memory and the stream of a backend. Every operation is put on one stream and returns before it has
// finished; what needs a result on the host waits.

#include "core/backend.hpp"
#include "kernels/host_memory.hpp"

#include <cuda_runtime.h>

#include <cstddef>
#include <map>
#include <memory>
#include <new>
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
  mutable PinnedSlots pinned_;
  mutable Fetcher fetcher_;
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

/// `size` values of T on the device, from the pool; not initialised.
template <class T>
class Memory {
 public:
  Memory() = default;
  Memory(const Device& device, std::size_t size) : stream_(device.stream()), size_(size) {
    if (size_ > 0) check(cudaMallocAsync(&data_, bytes(), stream_), "allocating device memory");
  }
  Memory(Memory&& other) noexcept { swap(other); }
  Memory& operator=(Memory&& other) noexcept {
    swap(other);
    return *this;
  }
  ~Memory() {
    if (data_) cudaFreeAsync(data_, stream_);
  }

  T* data() { return data_; }
  const T* data() const { return data_; }
  std::size_t size() const { return size_; }
  std::size_t bytes() const { return size_ * sizeof(T); }

  void clear() {
    if (size_ > 0) check(cudaMemsetAsync(data_, 0, bytes(), stream_), "clearing device memory");
  }
  /// From the host; the source may change once this returns.
  void put(const T* from) {
    if (size_ == 0) return;
    check(cudaMemcpyAsync(data_, from, bytes(), cudaMemcpyHostToDevice, stream_), "copying to the device");
    check(cudaStreamSynchronize(stream_), "copying to the device");
  }
  void get(T* to) const {
    if (size_ == 0) return;
    check(cudaMemcpyAsync(to, data_, bytes(), cudaMemcpyDeviceToHost, stream_), "copying from the device");
    check(cudaStreamSynchronize(stream_), "copying from the device");
  }

 private:
  void swap(Memory& other) {
    std::swap(stream_, other.stream_);
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
  }

  cudaStream_t stream_ = nullptr;
  T* data_ = nullptr;
  std::size_t size_ = 0;
};

/// Values from one row of an array to the next: rows begin at cache lines, which tensor cores and wide loads want, but
/// for short ones. What lies between is zero and stays zero.
inline Index stride(Index cols) { return cols < 16 ? cols : (cols + 7) / 8 * 8; }

class DeviceArray final : public Array {
 public:
  DeviceArray(const Device& device, Index rows, Index cols)
      : rows_(rows), cols_(cols), memory(device, std::size_t(rows * stride(cols))) {
    memory.clear();
  }
  Index rows() const override { return rows_; }
  Index cols() const override { return cols_; }

 private:
  Index rows_, cols_;

 public:
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
