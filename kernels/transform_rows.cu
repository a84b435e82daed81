// The orthonormal sine transform of rows of n = N - 1 values, N a power of two, in one kernel (transform_rows.cuh).

#include "kernels/launch.cuh"
#include "kernels/parts.hpp"
#include "kernels/transform_rows.cuh"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace bromwich::cuda {

namespace {

constexpr int held = 8;              ///< complex values per thread
constexpr int wanted_threads = 128;  ///< per block, for short rows
constexpr Index least_length = 16, largest_length = 4096;

template <int N>
__global__ void __launch_bounds__(N / held > wanted_threads ? N / held : wanted_threads)
    transform_rows(const double* in, const double* add, double* out, int rows, int stride,
                   const double2* __restrict__ roots, double scale) {
  extern __shared__ double2 memory[];
  const int row = int(blockIdx.x) * int(blockDim.y) + int(threadIdx.y);
  const long at = long(row) * stride;
  const bool there = row < rows;
  using Row = TransformRow<N, held>;
  const Row part{memory + int(threadIdx.y) * Row::size, roots, int(threadIdx.x)};
  double2 twiddles[Row::passes - 1];
  let_next_begin();
  part.template take_up<1>(twiddles);
  await_previous();
  part(
      twiddles, scale, [=](int i) { return there ? in[at + i] : 0; },
      [=](int i, double x) {
        if (there) out[at + i] = (add ? add[at + i] : 0) + x;
      });
}

/// e^{-i pi m/N}, m < 2N.
struct Roots {
  Roots(const Device& device, Index N) : N(N), values(device, std::size_t(2 * N)) {
    std::vector<double2> all(std::size_t(2 * N));
    for (Index m = 0; m < 2 * N; ++m) {
      const double angle = std::numbers::pi * double(m) / double(N);
      all[std::size_t(m)] = {std::cos(angle), -std::sin(angle)};
    }
    values.put(all.data());
  }

  Index N;
  Memory<double2> values;
};

class SineRows final : public RowTransform {
 public:
  SineRows(const Device& device, Index n)
      : device_(device),
        N_(n + 1),
        roots_(device.shared<Roots>([n](const Roots& kept) { return kept.N == n + 1; },
                                    [&] { return std::make_shared<Roots>(device, n + 1); })) {
    choose<least_length>();
    check(
        cudaFuncSetAttribute(kernel_, cudaFuncAttributeMaxDynamicSharedMemorySize, int(shared_bytes(most_together()))),
        "reserving shared memory");
  }

  void apply(const Array& in, const Array* add, Array& out, Index first) override {
    const Index rows = in.rows() - first, step = stride(N_ - 1);
    if (rows <= 0) return;
    // Distributes rows over all multiprocessors before it fills blocks.
    const Index even = (rows + device_.multiprocessors() - 1) / device_.multiprocessors();
    const Index together = std::clamp<Index>(even, std::max<Index>(32 / threads(), 1), most_together());
    follow(device_, kernel_,
           {unsigned((rows + together - 1) / together), dim3(unsigned(threads()), unsigned(together)),
            shared_bytes(together)},
           "the sine transform", values(in) + first * step, add ? values(*add) + first * step : nullptr,
           values(out) + first * step, int(rows), int(step), tables().roots, tables().scale);
  }

  SineTables tables() const { return {roots_->values.data(), -0.25 * std::sqrt(2.0 / double(N_))}; }

  std::size_t bytes() const override { return roots_->values.bytes(); }

 private:
  Index threads() const { return N_ / held; }
  Index most_together() const { return std::max<Index>(wanted_threads / threads(), 1); }
  std::size_t shared_bytes(Index rows) const { return sizeof(double2) * std::size_t(rows * (N_ + N_ / 8)); }

  template <int N>
  void choose() {
    if (N_ == N)
      kernel_ = transform_rows<N>;
    else if constexpr (N < largest_length)
      choose<2 * N>();
  }

  const Device& device_;
  Index N_;
  std::shared_ptr<Roots> roots_;
  void (*kernel_)(const double*, const double*, double*, int, int, const double2*, double) = nullptr;
};

}  // namespace

bool has_sine_rows(Index n) {
  const Index N = n + 1;
  return N >= least_length && N <= largest_length && (N & n) == 0;
}

SineTables sine_tables(const RowTransform& transform) { return static_cast<const SineRows&>(transform).tables(); }

std::unique_ptr<RowTransform> make_sine_rows(const Device& device, Index n) {
  return std::make_unique<SineRows>(device, n);
}

}  // namespace bromwich::cuda
