// Transforms of faces by half the length (half_transform.cuh), for so many faces that a device is full: lines, then
// neighbouring columns, which a block has in shared memory. A pass reads and writes each value once, and moves twice as
// many bytes a second as the kernels of face_transform.cu; those have more threads for a line, and shorter ones.

#include "kernels/face_halves.hpp"
#include "kernels/half_transform.cuh"
#include "kernels/launch.cuh"

#include <cuda_pipeline_primitives.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace bromwich::cuda {

namespace {

constexpr int block_threads = 128, blocks_together = 4;  ///< on a multiprocessor
constexpr Index least_length = 128, largest_length = 512;
constexpr const char* what = "the sine transform of faces";

/// A grid at each time: `lines` rows of `points` values, times `stride` values apart.
struct Faces {
  int lines, points, times, stride;
};

template <int N>
inline constexpr int rows_of_block = block_threads / HalfTransform<N>::threads;

// N - 1 = points of a line, or lines. Block: lines, or columns, of all grids one after the other. `in` may be `out`.
template <int N, bool of_columns>
__global__ void __launch_bounds__(block_threads, blocks_together)
    along(const double* in, const double* add, const double* factor, double* out, Faces s, HalfTables tables) {
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

using AlongKernel = void (*)(const double*, const double*, const double*, double*, Faces, HalfTables);

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
    std::vector<double2> unit(2 * N);
    for (int m = 0; m < 2 * N; ++m) {
      const double angle = std::numbers::pi * m / N;
      unit[std::size_t(m)] = {std::cos(angle), -std::sin(angle)};
    }
    roots = Memory<double2>(device, unit.size());
    roots.put(unit.data());
    const double scale = std::sqrt(2.0 / N);
    std::vector<double> all(N, 0.0);
    for (int j = 0; j < N; ++j) all[std::size_t(j)] = 0.5 * scale * std::sin(std::numbers::pi * j / N);
    sines = Memory<double>(device, all.size());
    sines.put(all.data());
    tables = {roots.data(), sines.data(), 0.25 * scale};
  }

  void run(const Device& device, const double* in, const double* add, const double* factor, double* out, const Faces& s,
           Index of_grid) const {
    follow(device, kernel, {unsigned((of_grid * s.times + rows - 1) / rows), unsigned(block_threads), bytes}, what, in,
           add, factor, out, s, tables);
  }
};

bool is_taken(Index n) { return n + 1 >= least_length && n + 1 <= largest_length && ((n + 1) & n) == 0; }

}  // namespace

struct FaceHalves::Tables {
  Direction lines, columns;
};

FaceHalves::FaceHalves(const Device& device, const std::vector<Index>& extents)
    : device_(device), lines_(extents[0]), points_(extents[1]), tables_(std::make_unique<Tables>()) {
  tables_->lines.choose<false>(device, points_ + 1);
  tables_->columns.choose<true>(device, lines_ + 1);
}

FaceHalves::~FaceHalves() = default;

bool FaceHalves::take(const std::vector<Index>& extents) {
  return extents.size() == 2 && is_taken(extents[0]) && is_taken(extents[1]);
}

bool FaceHalves::suits(Index rows) const {
  return rows * lines_ / tables_->lines.rows >= blocks_together * device_.multiprocessors();
}

void FaceHalves::apply(const double* in, const double* add, const double* factor, double* between, double* out,
                       Index rows) const {
  const Faces s{int(lines_), int(points_), int(rows), int(stride(lines_ * points_))};
  tables_->lines.run(device_, in, nullptr, nullptr, between, s, lines_);
  tables_->columns.run(device_, between, add, factor, out, s, points_);
}

std::size_t FaceHalves::bytes() const {
  return tables_->lines.roots.bytes() + tables_->lines.sines.bytes() + tables_->columns.roots.bytes() +
         tables_->columns.sines.bytes();
}

}  // namespace bromwich::cuda
