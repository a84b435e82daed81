// Which modes of a recurrence are scanned, and which are summed over the lags that they remember. In a diffusive scene
// memory shrinks with the square of the mode, so that those that are scanned are the first ones.

#include "core/memory_length.hpp"
#include "kernels/parts.hpp"

#include <algorithm>
#include <utility>

namespace bromwich::cuda {

namespace {

constexpr Index lanes = 32;               ///< modes that a warp takes together
constexpr Index scanned_memory = 192;     ///< lags that cost as much as a scan with 48 exponentials
constexpr double fewest_scanned = 1.5e8;  ///< multiply-adds of sums that take as long as starting a scan
constexpr Index rows_of_a_thread = 16;    ///< of sums, whose lags differ by so many

class DividedConvolution final : public Convolution {
 public:
  DividedConvolution(std::unique_ptr<Convolution> scan, std::unique_ptr<Convolution> direct)
      : scan_(std::move(scan)), direct_(std::move(direct)) {}

  void apply(const Array& y, Array& v, Index first) override {
    scan_->apply(y, v, first);
    direct_->apply(y, v, first);
  }
  std::size_t bytes() const override { return scan_->bytes() + direct_->bytes(); }

 private:
  std::unique_ptr<Convolution> scan_, direct_;
};

// Of a group of 32 modes.
double multiply_adds(Index length, Index rows) {
  const double lags = length < rows / 2 ? double(length) : double(rows) / 2;
  return double(lanes * rows) * (lags + double(rows_of_a_thread));
}

// The modes before the last group that remembers much; none where sums are few.
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

std::unique_ptr<Convolution> make_scan(const Device& device, const ModalRecurrence& r, Index rows) {
  const bool from_x0 = r.initial.size() > 0;
  const std::vector<Index> lengths = memory_lengths(r, std::max<Index>(rows - 1, 1));
  const Index scanned = from_x0 ? r.modes() : modes_to_scan(lengths, rows);
  if (scanned == 0) return make_direct_convolution(device, r, lengths, 0, rows);
  if (scanned == r.modes()) return make_modal_scan(device, r, scanned, rows);
  return std::make_unique<DividedConvolution>(make_modal_scan(device, r, scanned, rows),
                                              make_direct_convolution(device, r, lengths, scanned, rows));
}

}  // namespace bromwich::cuda
