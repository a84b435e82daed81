// Chooses, for the modes of a recurrence, between a scan and direct sums over the lags of their memory. In a diffusive
// scene memory shrinks with the square of the mode number, so the first modes are scanned.

#include "core/kernel/memory_length.hpp"
#include "kernels/parts.hpp"

#include <algorithm>

namespace bromwich::cuda {

namespace {

constexpr Index lanes = 32;               ///< modes per warp
constexpr Index scanned_memory = 192;     ///< lags of a direct sum that cost as much as a scan with 48 exponentials
constexpr double fewest_scanned = 1.5e8;  ///< multiply-adds of direct sums that take as long as starting a scan
constexpr Index taken_beyond = 16;        ///< extra lags of a direct sum: rows per thread, whole batches

// Scan and direct sums run concurrently, since neither fills the device.
class DividedConvolution final : public Convolution {
 public:
  DividedConvolution(const Device& device, const ModalRecurrence& r, const std::vector<Index>& lengths, Index scanned,
                     Index rows)
      : device_(device),
        beside_(device),
        scan_(make_modal_scan(device, r, scanned, rows)),
        direct_(make_direct_convolution(device, beside_.stream, r, lengths, scanned, rows)) {}

  void apply(const Array& y, Array& v, Index first) override {
    beside_.follow(device_.stream());
    direct_->apply(y, v, first);
    scan_->apply(y, v, first);
    beside_.join(device_.stream());
  }
  std::size_t bytes() const override { return scan_->bytes() + direct_->bytes(); }

 private:
  /// A side stream with fork (`follow`) and join (`join`) against another stream.
  struct Beside : SideStream {
    explicit Beside(const Device& device) : SideStream(device.side_streams().take()), device(device) {}
    ~Beside() { device.side_streams().give_back(*this); }
    Beside(const Beside&) = delete;
    Beside& operator=(const Beside&) = delete;

    void follow(cudaStream_t other) { order(begun, other, stream); }
    void join(cudaStream_t other) { order(ended, stream, other); }
    static void order(cudaEvent_t event, cudaStream_t before, cudaStream_t after) {
      check(cudaEventRecord(event, before), "ordering convolutions");
      check(cudaStreamWaitEvent(after, event, 0), "ordering convolutions");
    }

    const Device& device;
  };

  const Device& device_;
  Beside beside_;
  std::unique_ptr<Convolution> scan_, direct_;
};

// Of a group of 32 modes.
double multiply_adds(Index length, Index rows) {
  const double lags = length < rows / 2 ? double(length) : double(rows) / 2;
  return double(lanes * rows) * (lags + double(taken_beyond));
}

// Number of modes up to the last group with a long memory; 0 if direct sums are cheap for all.
Index modes_to_scan(const std::vector<Index>& lengths, Index rows) {
  const Index n = Index(lengths.size());
  Index scanned = 0;
  double sums = 0;
  for (Index l = 0; l < n; l += lanes) {
    const auto group = lengths.begin() + l;
    const Index longest = *std::max_element(group, group + std::min(lanes, n - l));
    sums += multiply_adds(longest, rows);
    if (longest > scanned_memory) scanned = std::min(l + lanes, n);
  }
  return sums < fewest_scanned ? 0 : scanned;
}

}  // namespace

std::unique_ptr<Convolution> make_convolution(const Device& device, const ModalRecurrence& r, Index rows) {
  const bool from_x0 = r.initial.size() > 0;
  // On a face modes of short and long memory alternate.
  if (!from_x0 && r.face.size() > 1) return make_shell_scan(device, r, rows);
  const std::vector<Index> lengths = memory_lengths(r, std::max<Index>(rows - 1, 1));
  const Index scanned = from_x0 ? r.modes() : modes_to_scan(lengths, rows);
  if (scanned == 0) return make_direct_convolution(device, device.stream(), r, lengths, 0, rows);
  if (scanned == r.modes()) return make_modal_scan(device, r, scanned, rows);
  return std::make_unique<DividedConvolution>(device, r, lengths, scanned, rows);
}

}  // namespace bromwich::cuda
