#include "kernels/host_memory.hpp"

#include "kernels/device.hpp"
#include "kernels/piece_relay.hpp"
#include "kernels/sparse_pieces.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <exception>
#include <thread>

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

constexpr std::size_t slots = 16, piece_bytes = std::size_t(1) << 20;
constexpr std::size_t sent_bytes = std::size_t(1) << 18;  ///< per piece on its way to the device
constexpr std::size_t parts = 16;                         ///< per piece, one thread each
constexpr int most_helpers = 8;                           ///< threads that empty the ring; more than the transfer needs
constexpr std::size_t alone_bytes = std::size_t(1) << 19;  ///< below it, one thread finishes before others wake up
constexpr std::size_t many_bytes = std::size_t(1) << 24;   ///< of an array: as many as the ring has
constexpr double few_others = 0.4;                         ///< of the values of an array
constexpr std::size_t slot_masks = piece_bytes / sizeof(double) / segment_values * segment_masks;
constexpr std::size_t masks_bytes = slot_masks * sizeof(std::uint64_t);

/// Which pieces of an array are packed: the first ones, and all others as long as few of their values are not zero.
/// With more of them a thread takes longer to put them into their places than they take to cross the bus.
class Packing {
 public:
  explicit Packing(bool possible) : possible_(possible) {}

  bool next(std::size_t piece) {
    const bool packs = possible_ && double(others_.load()) <= few_others * double(all_.load());
    return packed_[piece % slots] = packs;
  }
  bool of(std::size_t piece) const { return packed_[piece % slots]; }
  void found(std::size_t others, std::size_t all) {
    others_ += others;
    all_ += all;
  }

 private:
  bool possible_;
  std::array<bool, slots> packed_{};
  std::atomic<std::size_t> others_ = 0, all_ = 0;  ///< values of packed pieces that are not zero, and all of them
};

}  // namespace

Fetcher::Fetcher(int device)
    : device_(device), helpers_(std::clamp(int(std::thread::hardware_concurrency()) - 1, 0, most_helpers)) {}

void Fetcher::each_range(Index count, Index length, const std::function<void(Index first, Index last)>& body) {
  std::atomic<Index> next = 0;
  const auto work = [&]() noexcept {  // must not leave while others still work
    for (Index first; (first = length * next++) < count;) body(first, std::min(first + length, count));
  };
  if (busy_ || count <= length) return work();
  const Busy busy(busy_);
  helpers_.share(work, [] {});
}

Fetcher::~Fetcher() {
  if (stream_) cudaStreamDestroy(stream_);
  for (const cudaEvent_t copied : copied_) cudaEventDestroy(copied);
  if (ready_) cudaEventDestroy(ready_);
  if (sent_) cudaEventDestroy(sent_);
  if (ring_) cudaFreeHost(ring_);
}

void Fetcher::make() {
  if (!stream_) {  // pieces are packed while other kernels fill the device
    int least = 0, greatest = 0;
    check(cudaDeviceGetStreamPriorityRange(&least, &greatest), "asking the device");
    check(cudaStreamCreateWithPriority(&stream_, cudaStreamNonBlocking, greatest), "making a stream");
  }
  for (cudaEvent_t* event : {&ready_, &sent_})
    if (!*event) check(cudaEventCreateWithFlags(event, cudaEventDisableTiming), "making an event");
  if (!ring_) check(cudaMallocHost(&ring_, slots * (piece_bytes + masks_bytes)), "allocating pinned memory");
  while (copied_.size() < slots) {
    cudaEvent_t event = nullptr;
    check(cudaEventCreateWithFlags(&event, cudaEventDisableTiming), "making an event");
    copied_.push_back(event);
  }
}

void Fetcher::fetch(const double* from, std::size_t step, double* to, std::size_t cols, std::size_t rows,
                    cudaStream_t stream, const std::function<void()>& meanwhile) {
  const std::size_t pitch = sizeof(double) * step, width = sizeof(double) * cols;
  const std::size_t together = piece_bytes / pitch;  // rows per piece
  if (together == 0 || busy_) {
    check(cudaMemcpy2DAsync(to, width, from, pitch, width, rows, cudaMemcpyDeviceToHost, stream), "copying rows");
    check(cudaStreamSynchronize(stream), "copying rows");
    return meanwhile ? meanwhile() : void();
  }
  const Busy busy(busy_);
  make();
  check(cudaEventSynchronize(sent_), "copying rows");  // the ring is free
  check(cudaEventRecord(ready_, stream), "copying rows");
  check(cudaStreamWaitEvent(stream_, ready_, 0), "copying rows");
  const auto slot = [&](std::size_t piece) { return ring_ + piece % slots * (piece_bytes / sizeof(double)); };
  const auto count = [&](std::size_t piece) { return std::min(together, rows - piece * together); };
  const auto masks = [&](std::size_t piece) {
    return reinterpret_cast<std::uint64_t*>(ring_ + slots * (piece_bytes / sizeof(double))) +
           piece % slots * slot_masks;
  };
  const bool large = rows * pitch >= many_bytes;
  Packing packing(large);
  const auto start = [&](std::size_t piece) {
    const double* const source = from + piece * together * step;
    if (packing.next(piece))
      pack_segments(source, count(piece) * step, slot(piece), masks(piece), stream_);
    else
      check(cudaMemcpyAsync(slot(piece), source, count(piece) * pitch, cudaMemcpyDeviceToHost, stream_),
            "copying rows");
    check(cudaEventRecord(copied_[piece % slots], stream_), "copying rows");
  };
  const auto arrived = [&](std::size_t piece) {
    const cudaError_t status = cudaEventQuery(copied_[piece % slots]);
    if (status == cudaErrorNotReady) return cudaGetLastError(), false;  // clears the error state
    check(status, "copying rows");
    return true;
  };
  const auto take_out = [&](std::size_t piece, std::size_t part) {
    if (packing.of(piece)) {
      const std::size_t values = count(piece) * step, all = segments_of(values);
      const std::size_t first = all * part / parts, last = all * (part + 1) / parts;
      const PaddedRows shape = step == cols ? PaddedRows{values, values, 1} : PaddedRows{step, cols, count(piece)};
      packing.found(unpack_segments(slot(piece), masks(piece), first, last, shape, to + piece * together * cols),
                    std::min(last * segment_values, values) - std::min(first * segment_values, values));
      return;
    }
    const std::size_t all = count(piece), first = all * part / parts, last = all * (part + 1) / parts;
    const auto copy =
        large ? stream_copy : [](const double* in, std::size_t values, double* out) { std::copy_n(in, values, out); };
    if (step == cols) {
      copy(slot(piece) + first * step, (last - first) * step, to + (piece * together + first) * cols);
    } else {
      for (std::size_t j = first; j < last; ++j) copy(slot(piece) + j * step, cols, to + (piece * together + j) * cols);
    }
    if (large) end_streams();
  };
  PieceRelay relay((rows + together - 1) / together, parts, slots, start, arrived, take_out);
  relay.advance();  // starts the first pieces while helpers wake up
  std::exception_ptr failure;
  const auto attend = [&] {
    try {
      if (meanwhile) meanwhile();
    } catch (...) {
      failure = std::current_exception();
    }
  };
  const std::function<void()> work = [&] {
    cudaSetDevice(device_);
    relay.work();
  };
  if (rows * width > alone_bytes) {
    helpers_.share(work, attend);
  } else {
    attend();
    work();
  }
  if (!failure) failure = relay.failure();
  if (!failure) return;
  cudaStreamSynchronize(stream_);
  std::rethrow_exception(failure);
}

void Fetcher::send(const double* from, std::size_t count, double* to, cudaStream_t stream) {
  constexpr std::size_t piece = sent_bytes / sizeof(double), ring = slots * piece_bytes / sizeof(double);
  if (busy_ || count <= piece) {
    check(cudaMemcpyAsync(to, from, sizeof(double) * count, cudaMemcpyHostToDevice, stream), "copying to the device");
    check(cudaStreamSynchronize(stream), "copying to the device");
    return;
  }
  const Busy busy(busy_);
  make();
  for (std::size_t done = 0; done < count; done += ring) {
    check(cudaEventSynchronize(sent_), "copying to the device");  // the ring is free
    const std::size_t end = std::min(done + ring, count);
    std::atomic<std::size_t> next = done;
    std::atomic<cudaError_t> status = cudaSuccess;
    const std::function<void()> work = [&] {
      cudaSetDevice(device_);
      for (std::size_t begin; (begin = next.fetch_add(piece)) < end;) {
        const std::size_t size = std::min(piece, end - begin);
        double* const slot = ring_ + (begin - done);
        std::copy_n(from + begin, size, slot);
        const cudaError_t found =
            cudaMemcpyAsync(to + begin, slot, sizeof(double) * size, cudaMemcpyHostToDevice, stream);
        if (found != cudaSuccess) status = found;
      }
    };
    helpers_.share(work, [] {});
    check(status, "copying to the device");
    check(cudaEventRecord(sent_, stream), "copying to the device");
  }
}

}  // namespace bromwich::cuda
