#include "kernels/host_memory.hpp"

#include "kernels/device.hpp"
#include "kernels/piece_relay.hpp"

#include <omp.h>

#include <algorithm>
#include <cstring>
#include <exception>

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

constexpr std::size_t slots = 8, piece_bytes = std::size_t(1) << 19;
constexpr std::size_t parts = 4;                           ///< of a piece, each for one thread
constexpr int most_at_work = 8;                            ///< threads that empty the ring: faster than it fills
constexpr std::size_t alone_bytes = std::size_t(1) << 19;  ///< what one thread has done before others are awake

}  // namespace

// Teams of one size all over a solve: OpenMP ends threads that a smaller one leaves out, and starts them again.
void fill(double* to, std::size_t count, double value) {
  const std::size_t teams = std::size_t(omp_get_max_threads()), share = (count + teams - 1) / teams;
#pragma omp parallel for schedule(static, 1) if (count * sizeof(double) > alone_bytes)
  for (std::size_t mine = 0; mine < teams; ++mine)
    std::fill(to + std::min(count, mine * share), to + std::min(count, (mine + 1) * share), value);
}

Fetcher::~Fetcher() {
  if (stream_) cudaStreamDestroy(stream_);
  for (const cudaEvent_t copied : copied_) cudaEventDestroy(copied);
  if (ready_) cudaEventDestroy(ready_);
  if (ring_) cudaFreeHost(ring_);
}

void Fetcher::make() {
  if (!stream_) check(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "making a stream");
  if (!ready_) check(cudaEventCreateWithFlags(&ready_, cudaEventDisableTiming), "making an event");
  if (!ring_) check(cudaMallocHost(&ring_, slots * piece_bytes), "allocating pinned memory");
  while (copied_.size() < slots) {
    cudaEvent_t event = nullptr;
    check(cudaEventCreateWithFlags(&event, cudaEventDisableTiming), "making an event");
    copied_.push_back(event);
  }
}

void Fetcher::fetch(const void* from, std::size_t pitch, void* to, std::size_t width, std::size_t rows,
                    cudaStream_t stream, const std::function<void()>& meanwhile) {
  const std::size_t together = piece_bytes / pitch;  // rows of a piece
  if (together == 0) {
    check(cudaMemcpy2DAsync(to, width, from, pitch, width, rows, cudaMemcpyDeviceToHost, stream), "copying rows");
    check(cudaStreamSynchronize(stream), "copying rows");
    return meanwhile ? meanwhile() : void();
  }
  make();
  check(cudaEventRecord(ready_, stream), "copying rows");
  check(cudaStreamWaitEvent(stream_, ready_, 0), "copying rows");
  const auto slot = [&](std::size_t piece) { return static_cast<char*>(ring_) + piece % slots * piece_bytes; };
  const auto count = [&](std::size_t piece) { return std::min(together, rows - piece * together); };
  const auto start = [&](std::size_t piece) {
    const char* const source = static_cast<const char*>(from) + piece * together * pitch;
    check(cudaMemcpyAsync(slot(piece), source, count(piece) * pitch, cudaMemcpyDeviceToHost, stream_), "copying rows");
    check(cudaEventRecord(copied_[piece % slots], stream_), "copying rows");
  };
  const auto arrived = [&](std::size_t piece) {
    const cudaError_t status = cudaEventQuery(copied_[piece % slots]);
    if (status == cudaErrorNotReady) return cudaGetLastError(), false;  // it counts as an error
    check(status, "copying rows");
    return true;
  };
  const auto take_out = [&](std::size_t piece, std::size_t part) {
    const std::size_t all = count(piece), first = all * part / parts, last = all * (part + 1) / parts;
    for (std::size_t j = first; j < last; ++j)
      std::memcpy(static_cast<char*>(to) + (piece * together + j) * width, slot(piece) + j * pitch, width);
  };
  PieceRelay relay((rows + together - 1) / together, parts, slots, start, arrived, take_out);
  relay.advance();  // the first pieces are on their way while threads wake up
  std::exception_ptr failure;
  const auto attend = [&] {
    try {
      if (meanwhile) meanwhile();
    } catch (...) {
      failure = std::current_exception();
    }
  };
#pragma omp parallel if (rows * width > alone_bytes)
  {
    cudaSetDevice(device_);
    if (omp_get_thread_num() == 0) attend();
    if (omp_get_thread_num() <= most_at_work) relay.work();
  }
  if (!failure) failure = relay.failure();
  if (!failure) return;
  cudaStreamSynchronize(stream_);
  std::rethrow_exception(failure);
}

}  // namespace bromwich::cuda
