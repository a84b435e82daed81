// The orthonormal sine transform of rows that are indexed by two directions, a Q2 x Q3 grid at each time, one direction
// after the other. Where both have 2^k - 1 points: fast transforms of lines, or of neighbouring columns, that a block
// has in shared memory (half_transform.cuh), so that a pass reads and writes each value once. Otherwise products with
// the sine matrices, batched over times: no transposes, since a grid of either layout is a matrix to cuBLAS.

#include "kernels/blas.hpp"
#include "kernels/face_product.hpp"
#include "kernels/face_transform.hpp"
#include "kernels/half_transform.cuh"
#include "kernels/launch.cuh"
#include "kernels/parts.hpp"

#include "core/numerics/sine_basis.hpp"

#include <cuda_pipeline_primitives.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

namespace bromwich::cuda {

namespace {

constexpr int block_threads = 128;
constexpr const char* what = "the sine transform of a face";

/// e^{-i pi m/N}, m < 2N.
Memory<double2> roots_of(const Device& device, Index N) {
  std::vector<double2> all(std::size_t(2 * N));
  for (Index m = 0; m < 2 * N; ++m) {
    const double angle = std::numbers::pi * double(m) / double(N);
    all[std::size_t(m)] = {std::cos(angle), -std::sin(angle)};
  }
  Memory<double2> values(device, all.size());
  values.put(all.data());
  return values;
}

/// A grid at each time: `lines` rows of `points` values, times `stride` values apart.
struct FaceShape {
  int lines, points, times, stride;
};

template <int N>
inline constexpr int rows_of_block = block_threads / HalfTransform<N>::threads;

// N - 1 = points of a line, or lines. Block: lines, or columns, of all grids one after the other. `in` may be `out`.
template <int N, bool of_columns>
__global__ void __launch_bounds__(block_threads, 4)
    along(const double* in, const double* add, const double* factor, double* out, FaceShape s, HalfTables tables) {
  extern __shared__ double shared[];
  using Row = HalfTransform<N>;
  constexpr int n = N - 1, together = of_columns ? rows_of_block<N> : Row::in_warp;
  const int me = int(threadIdx.x), warp = me / 32, lane = me % 32;
  const int across = of_columns ? s.points : s.lines, step = of_columns ? s.points : 1;
  const long all = long(across) * s.times, begin = long(blockIdx.x) * rows_of_block<N>;
  // Calls each(entry in shared memory, index in the grid, offset in the array) for the values that a thread moves.
  const auto each_value = [&](const auto& each) {
    if constexpr (of_columns) {
      const int c = me % together;
      const long row = begin + c;
      if (row >= all) return;
      const int column = int(row % across);
      const long from = row / across * s.stride + column;
      double* const to = Row::of(shared, c);
      for (int i = me / together; i < n; i += block_threads / together)
        each(to[Row::place(i + 1)], long(i) * step + column, from + long(i) * step);
    } else {
      for (int c = warp * together; c < (warp + 1) * together && begin + c < all; ++c) {
        const int line = int((begin + c) % across);
        const long from = (begin + c) / across * s.stride + long(line) * s.points;
        double* const to = Row::of(shared, c);
#pragma unroll
        for (int i = lane; i < n; i += 32) each(to[Row::place(i + 1)], long(line) * s.points + i, from + i);
      }
    }
  };
  const auto meet = [] {
    if constexpr (of_columns)
      __syncthreads();
    else
      __syncwarp();
  };
  let_next_begin();
  await_previous();
  each_value([=](double& x, long, long at) { __pipeline_memcpy_async(&x, in + at, sizeof(double)); });
  __pipeline_commit();
  __pipeline_wait_prior(0);
  meet();
  Row{Row::of(shared, warp * Row::in_warp + lane % Row::in_warp), lane / Row::in_warp}(tables);
  meet();
  each_value(
      [=](double& x, long of_grid, long at) { out[at] = (add ? add[at] : 0) + (factor ? factor[of_grid] * x : x); });
}

constexpr Index least_length = 16, largest_length = 512;

bool is_fast(Index n) {
  const Index N = n + 1;
  return N >= least_length && N <= largest_length && (N & n) == 0;
}

using AlongKernel = void (*)(const double*, const double*, const double*, double*, FaceShape, HalfTables);

/// The transforms of one direction.
struct Direction {
  Memory<double2> roots;
  Memory<double> sines;
  HalfTables tables{};
  AlongKernel kernel = nullptr;
  Index rows = 1;
  std::size_t bytes = 0;

  template <bool of_columns, int N = int(least_length)>
  void choose(const Device& device, Index length) {
    if constexpr (N < largest_length)
      if (length > N) return choose<of_columns, 2 * N>(device, length);
    kernel = along<N, of_columns>;
    rows = rows_of_block<N>;
    bytes = sizeof(double) * std::size_t(HalfTransform<N>::size(int(rows)));
    check(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, int(bytes)),
          "reserving shared memory");
    roots = roots_of(device, N);
    const double scale = std::sqrt(2.0 / N);
    std::vector<double> all(N, 0.0);
    for (int j = 0; j < N; ++j) all[std::size_t(j)] = 0.5 * scale * std::sin(std::numbers::pi * j / N);
    sines = Memory<double>(device, all.size());
    sines.put(all.data());
    tables = {roots.data(), sines.data(), 0.25 * scale};
  }

  void run(const Device& device, const double* in, const double* add, const double* factor, double* out,
           const FaceShape& s, Index of_grid) const {
    follow(device, kernel, {unsigned((of_grid * s.times + rows - 1) / rows), unsigned(block_threads), bytes}, what, in,
           add, factor, out, s, tables);
  }
};

}  // namespace

struct FaceKernels::Tables {
  Direction lines, columns;
};

FaceKernels::FaceKernels(const Device& device, const std::vector<Index>& extents)
    : device_(device), lines_(extents[0]), points_(extents[1]), tables_(std::make_unique<Tables>()) {
  tables_->lines.choose<false>(device, points_ + 1);
  tables_->columns.choose<true>(device, lines_ + 1);
}

FaceKernels::~FaceKernels() = default;

bool FaceKernels::take(const std::vector<Index>& extents) {
  return extents.size() == 2 && is_fast(extents[0]) && is_fast(extents[1]);
}

void FaceKernels::apply(const double* in, const double* add, const double* factor, double* between, double* out,
                        Index rows) const {
  const FaceShape s{int(lines_), int(points_), int(rows), int(stride(lines_ * points_))};
  tables_->lines.run(device_, in, nullptr, nullptr, between, s, lines_);
  tables_->columns.run(device_, between, add, factor, out, s, points_);
}

std::size_t FaceKernels::bytes() const {
  return tables_->lines.roots.bytes() + tables_->lines.sines.bytes() + tables_->columns.roots.bytes() +
         tables_->columns.sines.bytes();
}

namespace {

class FastFace final : public SineTransform {
 public:
  FastFace(const Device& device, const std::vector<Index>& extents) : device_(device), kernels_(device, extents) {
    if (FaceProducts::take(device, extents)) products_.emplace(device);
  }

  void apply(const Array& in, const Array* add, Array& out, Index first) override {
    const Index rows = in.rows() - first, step = stride(in.cols());
    if (rows <= 0) return;
    if (products_ && !add && rows >= device_.multiprocessors() / 2)  // a block has a whole face
      return products_->apply(values(in) + first * step, values(out) + first * step, rows);
    Memory<double> kept;
    double* between = values(out) + first * step;
    if (add == &out) {
      kept = Memory<double>(device_, std::size_t(rows * step));
      between = kept.data();
    }
    kernels_.apply(values(in) + first * step, add ? values(*add) + first * step : nullptr, nullptr, between,
                   values(out) + first * step, rows);
  }

  std::size_t bytes() const override { return kernels_.bytes() + (products_ ? products_->bytes() : 0); }

 private:
  const Device& device_;
  FaceKernels kernels_;
  std::optional<FaceProducts> products_;
};

// Row-major grids are their transposes to cuBLAS: (X S)^T = S X^T, then (S X)^T = X^T S.
class FaceProduct final : public SineTransform {
 public:
  FaceProduct(const Device& device, Index lines, Index points)
      : device_(device),
        lines_(lines),
        points_(points),
        blas_(shared_blas(device)),
        of_lines_(on_device(device, sine_matrix(lines))),
        of_points_(on_device(device, sine_matrix(points))) {}

  void apply(const Array& in, const Array* add, Array& out, Index first) override {
    const Index rows = in.rows() - first, step = stride(lines_ * points_);
    if (rows <= 0) return;
    Memory<double> between(device_, std::size_t(rows * step));
    const double one = 1, none = 0;
    const int m = int(points_), n = int(lines_);
    if (add && add != &out)
      check(cudaMemcpyAsync(values(out) + first * step, values(*add) + first * step,
                            sizeof(double) * std::size_t(rows * step), cudaMemcpyDeviceToDevice, device_.stream()),
            "copying on the device");
    device_.note_work();
    check(cublasDgemmStridedBatched(blas_->handle, CUBLAS_OP_N, CUBLAS_OP_N, m, n, m, &one, of_points_.data(), m, 0,
                                    values(in) + first * step, m, step, &none, between.data(), m, step, int(rows)),
          what);
    check(cublasDgemmStridedBatched(blas_->handle, CUBLAS_OP_N, CUBLAS_OP_N, m, n, n, &one, between.data(), m, step,
                                    of_lines_.data(), n, 0, add ? &one : &none, values(out) + first * step, m, step,
                                    int(rows)),
          what);
  }

  std::size_t bytes() const override { return of_lines_.bytes() + of_points_.bytes(); }

 private:
  const Device& device_;
  Index lines_, points_;
  std::shared_ptr<Blas> blas_;
  Memory<double> of_lines_, of_points_;
};

}  // namespace

std::unique_ptr<SineTransform> make_face_transform(const Device& device, const std::vector<Index>& extents) {
  if (extents.size() != 2) return nullptr;
  if (FaceKernels::take(extents)) return std::make_unique<FastFace>(device, extents);
  return std::make_unique<FaceProduct>(device, extents[0], extents[1]);
}

}  // namespace bromwich::cuda
