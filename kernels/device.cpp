#include "kernels/device.hpp"

#include "core/error.hpp"

#include <algorithm>
#include <cstring>
#include <string>
#include <thread>

namespace bromwich::cuda {

void check(cudaError_t status, const char* what) {
  if (status == cudaSuccess) return;
  cudaGetLastError();  // it is told here, and not again by the next call
  const char* remedy = status == cudaErrorMemoryAllocation ? "use fewer steps or a smaller scene, or the cpu backend"
                                                           : "check the device with nvidia-smi, or use the cpu backend";
  throw Error("cuda", std::string(what) + " failed: " + cudaGetErrorString(status), remedy);
}

PinnedSlots::~PinnedSlots() {
  for (void* page : pages_) cudaFreeHost(page);
}

void* PinnedSlots::take() {
  constexpr std::size_t slots = 32;
  if (free_.empty()) {
    void* page = nullptr;
    check(cudaMallocHost(&page, slots * slot_bytes), "allocating pinned memory");
    pages_.push_back(page);
    for (std::size_t i = slots; i-- > 0;) free_.push_back(static_cast<char*>(page) + i * slot_bytes);
  }
  void* const slot = free_.back();
  free_.pop_back();
  return slot;
}

namespace {

constexpr std::size_t fetchers = 4, buffer_bytes = std::size_t(1) << 20;

}  // namespace

Fetchers::~Fetchers() {
  for (const Fetcher& f : fetchers_) {
    cudaStreamDestroy(f.stream);
    cudaFreeHost(f.buffer);
  }
  if (ready_) cudaEventDestroy(ready_);
}

void Fetchers::make() {
  check(cudaEventCreateWithFlags(&ready_, cudaEventDisableTiming), "making an event");
  while (fetchers_.size() < fetchers) {
    Fetcher& f = fetchers_.emplace_back();
    check(cudaStreamCreateWithFlags(&f.stream, cudaStreamNonBlocking), "making a stream");
    check(cudaMallocHost(&f.buffer, buffer_bytes), "allocating pinned memory");
  }
}

void Fetchers::fetch(const void* from, std::size_t pitch, void* to, std::size_t width, std::size_t rows,
                     cudaStream_t stream) {
  const std::size_t together = buffer_bytes / pitch;  // rows of a piece
  if (together == 0) {
    check(cudaMemcpy2DAsync(to, width, from, pitch, width, rows, cudaMemcpyDeviceToHost, stream), "copying rows");
    return check(cudaStreamSynchronize(stream), "copying rows");
  }
  if (!ready_) make();
  check(cudaEventRecord(ready_, stream), "copying rows");
  const std::size_t pieces = (rows + together - 1) / together, at_work = std::min(pieces, fetchers);
  std::vector<cudaError_t> errors(at_work, cudaSuccess);
  const auto work = [&](std::size_t mine) {
    const Fetcher& f = fetchers_[mine];
    cudaError_t& error = errors[mine];
    const auto done = [&error](cudaError_t status) { return (error = status) == cudaSuccess; };
    if (!done(cudaSetDevice(device_)) || !done(cudaStreamWaitEvent(f.stream, ready_, 0))) return;
    for (std::size_t piece = mine; piece < pieces; piece += at_work) {
      const std::size_t first = piece * together, count = std::min(together, rows - first);
      const char* const source = static_cast<const char*>(from) + first * pitch;
      if (!done(cudaMemcpyAsync(f.buffer, source, count * pitch, cudaMemcpyDeviceToHost, f.stream)) ||
          !done(cudaStreamSynchronize(f.stream)))
        return;
      for (std::size_t j = 0; j < count; ++j)
        std::memcpy(static_cast<char*>(to) + (first + j) * width, static_cast<const char*>(f.buffer) + j * pitch,
                    width);
    }
  };
  {
    std::vector<std::jthread> others;
    for (std::size_t mine = 1; mine < at_work; ++mine) others.emplace_back(work, mine);
    work(0);
  }
  for (const cudaError_t error : errors) check(error, "copying rows");
}

Device::Device(int number) : fetchers_(number) {
  check(cudaSetDevice(number), "choosing the device");
  check(cudaDeviceGetAttribute(&multiprocessors_, cudaDevAttrMultiProcessorCount, number), "asking the device");
  check(cudaDeviceGetAttribute(&shared_memory_, cudaDevAttrMaxSharedMemoryPerBlockOptin, number), "asking the device");
  check(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "making a stream");
  // What has been freed stays with the pool, so that no plan waits for the driver twice.
  cudaMemPool_t pool;
  check(cudaDeviceGetDefaultMemPool(&pool, number), "asking for the memory pool");
  std::uint64_t keep = ~std::uint64_t(0);
  check(cudaMemPoolSetAttribute(pool, cudaMemPoolAttrReleaseThreshold, &keep), "setting up the memory pool");
}

Device::~Device() {
  kept_.clear();
  cudaStreamSynchronize(stream_);
  cudaStreamDestroy(stream_);
}

}  // namespace bromwich::cuda
