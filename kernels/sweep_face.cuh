#pragma once
// The kernel of sweeps of projected over-relaxation in two colours on a face.
//
// A block walks once down lines of the grid of a time point with a few of them in shared memory, and makes all
// half-sweeps on the way. When half-sweep 0 is at line t, half-sweep s is at line t - 2 s, line t + 2 arrives from
// memory, and the load of line t + 3 begins. Half-sweep s of a line needs half-sweep s - 1 of its two neighbours, which
// is done by then, so that one barrier a step is enough, and r, v and y are read and written once for all sweeps.
//
// Where time points are too few for all multiprocessors, a cluster of blocks divides the lines into bands. A block
// walks down its band and as many lines on both sides of it as there are half-sweeps: what is wrong at the ends of
// these does not reach the band, which is the same to the last bit.

#include "kernels/launch.cuh"
#include "kernels/lcp_batch.hpp"
#include "kernels/lcp_outcome.cuh"

#include <cooperative_groups.h>

namespace bromwich::cuda {

/// M + D I on lines x points.
struct FaceStencil {
  int lines, points, stride;
  double across, along;  ///< neighbours on other lines, on the same line
  double centre, shift, keep, scale;
};

__device__ inline double largest_of_block(double mine, double* shared) {
  const int lane = int(threadIdx.x) % 32, warp = int(threadIdx.x) / 32, warps = (int(blockDim.x) + 31) / 32;
  for (int far = 16; far > 0; far /= 2) mine = larger(__shfl_xor_sync(~0u, mine, far), mine);
  __syncthreads();
  if (lane == 0) shared[warp] = mine;
  __syncthreads();
  double all = 0;
  for (int w = 0; w < warps; ++w) all = larger(shared[w], all);
  return all;
}

template <int halves>
struct Window {
  static constexpr int of_y = 2 * halves + 2, of_q = 2 * halves + 1;  ///< lines kept
  static std::size_t bytes(Index points, unsigned bands) {
    return sizeof(double) *
           (std::size_t((of_y + of_q) * (points + 2)) + (bands > 1 ? std::size_t(2 * halves * points) : 0));
  }
};

/// The lines of a block: [begin, end) are its own, [from, to) are those that it needs for them.
struct Band {
  int begin, end, from, to;

  /// All lines.
  __device__ explicit Band(int lines) : begin(0), end(lines), from(0), to(lines) {}
  /// Those of this block of its cluster.
  __device__ Band(int lines, int beside)
      : begin(int(long(lines) * blockIdx.y / gridDim.y)),
        end(int(long(lines) * (blockIdx.y + 1) / gridDim.y)),
        from(max(0, begin - beside)),
        to(min(lines, end + beside)) {}

  __device__ bool owns(int line) const { return line >= begin && line < end; }
  __device__ int others() const { return begin - from + to - end; }
  /// Lines of other blocks, counted from 0.
  __device__ int other(int k) const { return k < begin - from ? from + k : end + k - (begin - from); }
  __device__ int number(int line) const { return line < begin ? line - from : begin - from + line - end; }
};

__device__ inline void await_cluster() {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
  cooperative_groups::this_cluster().sync();
#endif
}

/// Writes the value to the same place of the first block of the cluster.
__device__ inline void give_first_block(double* shared, double value) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
  *cooperative_groups::this_cluster().map_shared_rank(shared, 0) = value;
#endif
}

constexpr unsigned most_bands = 8;  ///< a cluster may have as many on all devices

// The largest values of all blocks of the cluster, in the first one.
__device__ inline void largest_of_cluster(double& change, double& magnitude) {
  __shared__ double of_bands[2][most_bands];
  if (threadIdx.x == 0) {
    give_first_block(&of_bands[0][blockIdx.y], change);
    give_first_block(&of_bands[1][blockIdx.y], magnitude);
  }
  await_cluster();
  for (unsigned b = 0; b < gridDim.y && blockIdx.y == 0; ++b) {
    change = larger(of_bands[0][b], change);
    magnitude = larger(of_bands[1][b], magnitude);
  }
}

// `moved`: per row the largest change by the last sweep, relative to the largest value of 1 and y; null if not wanted.
template <int halves, bool in_bands>
__global__ void __launch_bounds__(1024, 2)
    sweep_face(LcpArrays arrays, FaceStencil m, int first, OutcomeTarget target, double* moved) {
  extern __shared__ double shared[];
  __shared__ double scratch[32];
  using Kept = Window<halves>;
  const int width = m.points + 2, me = int(threadIdx.x), all = int(blockDim.x), half = all / halves;
  const int s = me / half, i = me % half, j = first + int(blockIdx.x);
  const Band band = in_bands ? Band(m.lines, halves) : Band(m.lines);
  double *const ys = shared, *const qs = ys + Kept::of_y * width, *const of_others = qs + Kept::of_q * width;
  let_next_begin();
  for (int a = me; a < (Kept::of_y + Kept::of_q) * width; a += all) shared[a] = 0;
  await_previous();
  const double *const r = arrays.r + long(j) * m.stride, *const v = arrays.v + long(j) * m.stride;
  double* const y = arrays.y + long(j) * m.stride;
  if constexpr (in_bands) {  // before their blocks change them
    for (int a = me; a < band.others() * m.points; a += all)
      of_others[a] = y[band.other(a / m.points) * m.points + a % m.points];
    await_cluster();
  }
  __syncthreads();
  const bool loads = me < m.points;
  const auto old_y = [&](int line) {
    if constexpr (in_bands)
      if (!band.owns(line)) return of_others[band.number(line) * m.points + me];
    return y[line * m.points + me];
  };
  const auto put = [&](int line, double value, double q) {
    ys[line % Kept::of_y * width + 1 + me] = value;
    qs[line % Kept::of_q * width + 1 + me] = q - m.shift * value;
  };
  for (int line = band.from; line < min(band.from + 2, band.to); ++line)
    if (loads) {
      const int at = line * m.points + me;
      put(line, old_y(line), r[at] + v[at]);
    }
  __syncthreads();
  double change = 0, magnitude = 0;
  double next = 0, r_next = 0, v_next = 0, later = 0, r_later = 0, v_later = 0;  // lines t + 2 and t + 3
  if (loads && band.from + 2 < band.to) {
    const int at = (band.from + 2) * m.points + me;
    next = old_y(band.from + 2), r_next = r[at], v_next = v[at];
  }
  for (int t = band.from; t < band.to + 2 * halves - 1; ++t) {
    const int coming = t + 2, gone = t - 2 * halves + 1, line = t - 2 * s;
    const bool fetches = loads && coming < band.to;
    if (loads && coming + 1 < band.to) {
      const int at = (coming + 1) * m.points + me;
      later = old_y(coming + 1), r_later = r[at], v_later = v[at];
    }
    const int column = 2 * i + (line + s & 1);
    if (line >= band.from && line < band.to && column < m.points) {
      double* const at = ys + line % Kept::of_y * width + 1 + column;
      const double above = line > 0 ? ys[(line - 1) % Kept::of_y * width + 1 + column] : 0;
      const double below = line + 1 < m.lines ? ys[(line + 1) % Kept::of_y * width + 1 + column] : 0;
      const double sum =
          qs[line % Kept::of_q * width + 1 + column] + m.across * (above + below) + m.along * (at[-1] + at[1]);
      const double old = *at, value = m.keep * old - m.scale * sum, fresh = value <= 0 ? 0 : value;  // keeps a NaN
      *at = fresh;
      if (s >= halves - 2 && (!in_bands || band.owns(line))) {
        change = larger(fabs(fresh - old), change);
        magnitude = larger(fabs(fresh), magnitude);
      }
    }
    if (loads && band.owns(gone)) y[gone * m.points + me] = ys[gone % Kept::of_y * width + 1 + me];
    if (fetches) put(coming, next, r_next + v_next);
    next = later, r_next = r_later, v_next = v_later;
    __syncthreads();
  }
  change = largest_of_block(change, scratch);
  magnitude = largest_of_block(magnitude, scratch);
  if constexpr (in_bands) {
    largest_of_cluster(change, magnitude);
    if (blockIdx.y > 0) return;
  }
  Outcomes outcomes(target);
  if (me == 0) {
    outcomes.solved(j, halves / 2, change, magnitude);
    if (moved) moved[blockIdx.x] = change / fmax(1.0, magnitude);
  }
  outcomes.finish();
}

}  // namespace bromwich::cuda
