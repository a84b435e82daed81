#pragma once
// What the kernels of a scan share (convolution_scan.cu, convolution_walk.cu).

#include "core/kernel/shells.hpp"
#include "kernels/device.hpp"

#include <memory>
#include <optional>
#include <vector>

namespace bromwich::cuda::scan {

inline constexpr int lanes = 32, group = 8, tile = 16;

/// K x n tables with the mode index contiguous; K is a multiple of `group`, n of `lanes`.
struct Tables {
  const double *decay, *power, *output, *start, *initial, *w0, *w1, *s1;
  int exponentials, modes, stride;  ///< stride = padded n
  const int* counts;                ///< exponentials of each group of `lanes` modes, multiples of `group`; null: all
  __device__ int count() const { return counts ? __ldg(counts + blockIdx.x) : exponentials; }
  int step;  ///< of y and v, between rows
};

struct Span {
  int from, chunks, length, rows;  ///< chunks from .. chunks-1 of `length` rows each, beginning at row 1
  __device__ int begin(int c) const { return 1 + c * length; }
  __device__ int end(int c) const { return min(rows, 1 + (c + 1) * length); }
};

/// Rows j .. j + tile - 1 of one mode; rows past the end repeat the last row.
__device__ inline void read_tile(const double* column, int step, int j, int rows, double (&u)[tile]) {
#pragma unroll
  for (int i = 0; i < tile; ++i) u[i] = column[long(min(j + i, rows - 1)) * step];
}

/// base^exponent for exponent >= 1, by repeated squaring.
__device__ inline double power(double base, int exponent) {
  double result = 1;
  for (; exponent > 0; exponent >>= 1, base *= base)
    if (exponent & 1) result *= base;
  return result;
}

/// A scan as a plan.
class Scan : public Convolution {
 public:
  virtual Tables tables() const = 0;
  /// The table of the same name, K x `stride`, which may change between calls of apply.
  virtual double* initial() = 0;

  /// The states that chunks add to zero: [chunk][K][stride].
  struct Chunks {
    Span span;
    double* added;
  };
  /// Computes those of all chunks but the last, of which the next `apply`, to the same y, makes use. Nothing where
  /// there are no chunks, or many.
  virtual std::optional<Chunks> add_up_chunks(const Array& y) = 0;
};
struct TableSize {
  Index modes, exponentials, stride, length;  ///< modes: the first ones of the recurrence; length: of a chunk
};
/// Decays E, E^length, outputs, starts and contributions of x0, `exponentials` rows each, then w0, w1 and s1, padded
/// with zeros. `shells`: null, or those into which the recurrence is brought. Waits for the device.
Memory<double> form_tables(const Device&, const ModalRecurrence&, const Shells* shells, TableSize);

/// Threads of the host, as those of the backend.
class DeviceThreads final : public HostThreads {
 public:
  explicit DeviceThreads(const Device& device) : device_(device) {}
  void each_range(Index count, Index length, const std::function<void(Index first, Index last)>& body) const override {
    device_.fetcher().each_range(count, length, body);
  }

 private:
  const Device& device_;
};

/// The exponentials of each group of `lanes` modes, in multiples of `group`.
std::vector<int> counts_of(const Shells&);
/// `counts`: of exponentials of each group of modes, the others being zero; empty: all.
std::unique_ptr<Scan> make_scan(const Device&, const ModalRecurrence& r, Index modes, Index rows,
                                const std::vector<int>& counts);
/// Brings `r` into shells.
std::unique_ptr<Scan> make_scan(const Device&, const ModalRecurrence& r, const Shells&, Index rows);

/// What a warp of a walk does: exponentials 16 part ... of a group of modes.
struct WalkSlot {
  int group = -1, part = 0, parts = 1, count = 0;  ///< group < 0: nothing; count: of its exponentials
};

/// All chunks one after the other, where there are many modes.
class Walk {
 public:
  /// Whether it is faster than a scan.
  static bool suits(const Device&, Index modes, Index exponentials);
  /// `counts`: exponentials of each group of `lanes` modes.
  Walk(const Device&, const std::vector<int>& counts);
  /// Begins with the states of chunk span.from, or with x0 and y_0 if that is 0. Keeps the states of the other chunks.
  void run(const Tables&, const Span&, const double* y, double* states, double* v) const;
  std::size_t bytes() const { return slots_.bytes(); }

 private:
  const Device& device_;
  Memory<WalkSlot> slots_;
};

}  // namespace bromwich::cuda::scan
