#include "kernels/host_memory.hpp"

#include "kernels/device.hpp"

#include <omp.h>

#include <algorithm>
#include <cstring>

namespace bromwich::cuda {

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

constexpr std::size_t most_fetchers = 8, buffer_bytes = std::size_t(1) << 20, piece_bytes = buffer_bytes / 2;

std::size_t fetchers() {
  static const std::size_t count = std::clamp<std::size_t>(std::size_t(omp_get_num_procs()), 1, most_fetchers);
  return count;
}

}  // namespace

void fill(double* to, std::size_t count, double value) {
  const std::size_t at_work = count * sizeof(double) < buffer_bytes ? 1 : fetchers(), share = count / at_work;
  const auto work = [&](std::size_t mine) {
    std::fill(to + mine * share, mine + 1 < at_work ? to + (mine + 1) * share : to + count, value);
  };
#pragma omp parallel for schedule(static, 1) num_threads(int(at_work))
  for (std::size_t mine = 0; mine < at_work; ++mine) work(mine);
}

Fetchers::~Fetchers() {
  for (const Fetcher& f : fetchers_) {
    cudaStreamDestroy(f.stream);
    for (const cudaEvent_t copied : f.copied) cudaEventDestroy(copied);
    cudaFreeHost(f.buffer);
  }
  if (ready_) cudaEventDestroy(ready_);
}

void Fetchers::make() {
  if (!ready_) check(cudaEventCreateWithFlags(&ready_, cudaEventDisableTiming), "making an event");
  while (fetchers_.size() < fetchers()) {
    Fetcher f;
    check(cudaMallocHost(&f.buffer, buffer_bytes), "allocating pinned memory");
    check(cudaStreamCreateWithFlags(&f.stream, cudaStreamNonBlocking), "making a stream");
    for (cudaEvent_t& copied : f.copied)
      check(cudaEventCreateWithFlags(&copied, cudaEventDisableTiming), "making an event");
    fetchers_.push_back(f);
  }
}

void Fetchers::fetch(const void* from, std::size_t pitch, void* to, std::size_t width, std::size_t rows,
                     cudaStream_t stream) {
  const std::size_t together = piece_bytes / pitch;  // rows of a piece
  if (together == 0) {
    check(cudaMemcpy2DAsync(to, width, from, pitch, width, rows, cudaMemcpyDeviceToHost, stream), "copying rows");
    return check(cudaStreamSynchronize(stream), "copying rows");
  }
  if (fetchers_.size() < fetchers()) make();
  check(cudaEventRecord(ready_, stream), "copying rows");
  const std::size_t pieces = (rows + together - 1) / together, at_work = std::min(pieces, fetchers());
  std::vector<cudaError_t> errors(at_work, cudaSuccess);
  const auto work = [&](std::size_t mine) {
    const Fetcher& f = fetchers_[mine];
    cudaError_t& error = errors[mine];
    const auto done = [&error](cudaError_t status) { return (error = status) == cudaSuccess; };
    if (!done(cudaSetDevice(device_)) || !done(cudaStreamWaitEvent(f.stream, ready_, 0))) return;
    const auto half = [&](std::size_t turn) { return static_cast<char*>(f.buffer) + turn % 2 * piece_bytes; };
    const auto count = [&](std::size_t piece) { return std::min(together, rows - piece * together); };
    const auto start = [&](std::size_t piece, std::size_t turn) {
      const char* const source = static_cast<const char*>(from) + piece * together * pitch;
      return done(cudaMemcpyAsync(half(turn), source, count(piece) * pitch, cudaMemcpyDeviceToHost, f.stream)) &&
             done(cudaEventRecord(f.copied[turn % 2], f.stream));
    };
    if (!start(mine, 0)) return;
    for (std::size_t piece = mine, turn = 0; piece < pieces; piece += at_work, ++turn) {
      if (piece + at_work < pieces && !start(piece + at_work, turn + 1)) return;
      if (!done(cudaEventSynchronize(f.copied[turn % 2]))) return;
      char* const target = static_cast<char*>(to) + piece * together * width;
      for (std::size_t j = 0; j < count(piece); ++j) std::memcpy(target + j * width, half(turn) + j * pitch, width);
    }
  };
#pragma omp parallel for schedule(static, 1) num_threads(int(at_work))
  for (std::size_t mine = 0; mine < at_work; ++mine) work(mine);
  for (const cudaError_t error : errors) check(error, "copying rows");
}

}  // namespace bromwich::cuda
