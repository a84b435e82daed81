// The scan of convolution_scan.cu where there are modes for all warps of a device: a warp takes 32 neighbouring modes
// through all rows, so that y is read once and v written once. Two multiply-adds per value and exponential.
//
// A warp has the states z of up to 16 exponentials in registers, their E and C in shared memory. Modes that need more
// are taken by several warps of a block, whose sums are brought together in shared memory. A tile of rows is in
// registers while the next one arrives. The states at the beginning of each chunk are kept, as a scan keeps them.

#include "kernels/convolution_scan.cuh"
#include "kernels/launch.cuh"

#include <algorithm>
#include <numeric>

namespace bromwich::cuda::scan {

namespace {

constexpr int warps = 4;            ///< of a block
constexpr int of_warp = 16;         ///< exponentials
constexpr int rows_together = 8;    ///< of a tile
constexpr int blocks_together = 4;  ///< on a multiprocessor, by their registers
constexpr Index wanted_warps = 8;   ///< of a multiprocessor
static_assert(tile % rows_together == 0, "chunks are whole tiles");

constexpr std::size_t shared_bytes = sizeof(double) * warps * lanes * (2 * of_warp + 2 * rows_together);

__device__ inline void read_rows(const double* column, int step, int j, int rows, double (&u)[rows_together]) {
#pragma unroll
  for (int i = 0; i < rows_together; ++i) u[i] = column[long(min(j + i, rows - 1)) * step];
}

/// Shared memory of a warp: E, C, and its sums of two tiles.
struct OfWarp {
  double *E, *C, *sums;
  __device__ OfWarp(double* shared, int warp)
      : E(shared + warp * (2 * of_warp + 2 * rows_together) * lanes + int(threadIdx.x)),
        C(E + of_warp * lanes),
        sums(C + of_warp * lanes) {}
};

// The warps of a group have written their sums.
__device__ inline void meet_group(int first, int parts) {
  asm volatile("bar.sync %0, %1;" ::"r"(first + 1), "r"(lanes * parts));
}

__global__ void __launch_bounds__(lanes* warps, blocks_together)
    walk(Tables m, Span span, const WalkSlot* slots, const double* y, double* states, double* v) {
  extern __shared__ double shared[];
  let_next_begin();
  const int warp = int(threadIdx.y);
  const WalkSlot slot = slots[int(blockIdx.x) * warps + warp];
  if (slot.group < 0) return;
  const int l = slot.group * lanes + int(threadIdx.x), first = warp - slot.part;
  const long table = long(slot.part) * of_warp * m.stride + l;
  const OfWarp own(shared, warp);
#pragma unroll
  for (int k = 0; k < of_warp; ++k) {
    own.E[k * lanes] = k < slot.count ? __ldg(m.decay + table + long(k) * m.stride) : 0;
    own.C[k * lanes] = k < slot.count ? __ldg(m.output + table + long(k) * m.stride) : 0;
  }
  const bool given = l < m.modes, leads = given && slot.part == 0;
  const double w0 = leads ? __ldg(m.w0 + l) : 0, w1 = leads ? __ldg(m.w1 + l) : 0, s1 = leads ? __ldg(m.s1 + l) : 0;
  const double* const column = y + (given ? l : 0);
  double* const out = v + (given ? l : 0);
  await_previous();
  int chunk = span.from;
  const long apart = long(m.exponentials) * m.stride;
  double z[of_warp];
#pragma unroll
  for (int k = 0; k < of_warp; ++k) {
    const long at = table + long(k) * m.stride;
    z[k] = 0;
    if (k < slot.count) z[k] = chunk > 0 ? states[chunk * apart + at] : __ldg(m.start + at) * column[0] + m.initial[at];
  }
  if (chunk == 0 && leads) out[0] = 0;
  double before = column[long(span.begin(chunk) - 1) * m.step], u[rows_together], next[rows_together];
  read_rows(column, m.step, span.begin(chunk), span.rows, next);
  for (int j = span.begin(chunk), now = 0; j < span.rows; j += rows_together, now ^= 1) {
    if (j == span.begin(chunk)) {
#pragma unroll
      for (int k = 0; k < of_warp; ++k)
        if (k < slot.count) states[chunk * apart + table + long(k) * m.stride] = z[k];
      ++chunk;
    }
    double sum[rows_together];
#pragma unroll
    for (int i = 0; i < rows_together; ++i) {
      u[i] = next[i];
      sum[i] = w0 * u[i] + (i == 0 && j == 1 ? s1 : w1) * (i > 0 ? u[i > 0 ? i - 1 : 0] : before);
    }
    before = u[rows_together - 1];
    if (j + rows_together < span.rows) read_rows(column, m.step, j + rows_together, span.rows, next);
#pragma unroll
    for (int k = 0; k < of_warp; ++k) {
      const double E = own.E[k * lanes], C = own.C[k * lanes];
#pragma unroll
      for (int i = 0; i < rows_together; ++i) {
        sum[i] += C * z[k];
        z[k] = E * z[k] + u[i];
      }
    }
    if (slot.parts == 1) {
#pragma unroll
      for (int i = 0; i < rows_together; ++i)
        if (given && j + i < span.rows) out[long(j + i) * m.step] = sum[i];
    } else {
#pragma unroll
      for (int i = 0; i < rows_together; ++i) own.sums[(now * rows_together + i) * lanes] = sum[i];
      meet_group(first, slot.parts);
      for (int i = slot.part; i < rows_together; i += slot.parts) {
        double all = 0;
        for (int p = 0; p < slot.parts; ++p) all += OfWarp(shared, first + p).sums[(now * rows_together + i) * lanes];
        if (given && j + i < span.rows) out[long(j + i) * m.step] = all;
      }
    }
  }
}

int parts_of(int count) { return std::max((count + of_warp - 1) / of_warp, 1); }

// Groups with many parts first; those of a group are warps of one block.
std::vector<WalkSlot> slots_of(const std::vector<int>& counts) {
  std::vector<int> order(counts.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return parts_of(counts[std::size_t(a)]) > parts_of(counts[std::size_t(b)]); });
  std::vector<WalkSlot> slots;
  const auto fill = [&] {
    while (slots.size() % warps != 0) slots.push_back({});
  };
  for (const int g : order) {
    const int count = counts[std::size_t(g)], parts = parts_of(count);
    if (int(slots.size() % warps) + parts > warps) fill();
    for (int p = 0; p < parts; ++p) slots.push_back({g, p, parts, std::min(count - p * of_warp, of_warp)});
  }
  fill();
  return slots;
}

}  // namespace

bool Walk::suits(const Device& device, Index modes, Index exponentials) {
  return (modes + lanes - 1) / lanes >= wanted_warps * device.multiprocessors() && exponentials <= warps * of_warp;
}

Walk::Walk(const Device& device, const std::vector<int>& counts) : device_(device) {
  const std::vector<WalkSlot> slots = slots_of(counts);
  slots_ = Memory<WalkSlot>(device, slots.size());
  slots_.put(slots.data());
  check(cudaFuncSetAttribute(walk, cudaFuncAttributeMaxDynamicSharedMemorySize, int(shared_bytes)),
        "reserving shared memory");
}

void Walk::run(const Tables& m, const Span& span, const double* y, double* states, double* v) const {
  follow(device_, walk, {unsigned(slots_.size() / warps), dim3(lanes, warps), shared_bytes}, "starting the scan", m,
         span, slots_.data(), y, states, v);
}

}  // namespace bromwich::cuda::scan
