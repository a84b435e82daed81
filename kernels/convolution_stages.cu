// Causal convolution with two stages in each step (core/seam/recurrence.hpp, StageRecurrence) as a chunked scan like
// kernels/convolution_scan.cu: (1) accumulate: the state that each chunk of steps adds to zero; (2) carry: the state at
// the start of each chunk; (3) apply. Both stages share one state.
//
// A block takes 32 neighbouring modes and one chunk. Each of its warps keeps `group` exponentials of these modes in
// registers; their parts of v are summed in shared memory, a tile of steps at a time. Five multiply-adds per step, mode
// and exponential, and three in the first pass.

#include "kernels/convolution_stages.hpp"

#include "kernels/entry_powers.hpp"
#include "kernels/launch.cuh"

#include <algorithm>

namespace bromwich::cuda {

namespace {

constexpr int lanes = 32, group = 8;
constexpr int most_warps = 12;  ///< by the registers of a multiprocessor
constexpr int tile = 4;         ///< steps
constexpr int values_of_tile = 2 * tile;
constexpr Index shortest_chunk = 16, most_chunks = 64;  ///< steps; chunks are carried one after the other
constexpr Index wanted_blocks = 4;                      ///< per multiprocessor
constexpr const char* starting = "starting the scan of stages";

/// K x n tables with the mode index contiguous, K a multiple of `group`, n of `lanes`.
struct StageScanTables {
  const double *decay, *power, *input[2], *output[2];
  const double* direct;  ///< rows W_11, W_12, W_21, W_22, w1_1, w1_2
  int exponentials, modes, stride;
  int step;  ///< of y and v, between rows
};

struct Chunks {
  int count, length, steps;  ///< chunk c has the steps 1 + c length, ...
  __device__ int begin(int c) const { return 1 + c * length; }
  __device__ int end(int c) const { return min(steps + 1, 1 + (c + 1) * length); }
};

/// The exponentials of a warp for one mode.
struct Held {
  double E[group], G[2][group], z[group];

  __device__ Held(const StageScanTables& m, int k0, int l) {
#pragma unroll
    for (int g = 0; g < group; ++g) {
      const long at = long(k0 + g) * m.stride + l;
      E[g] = __ldg(m.decay + at), G[0][g] = __ldg(m.input[0] + at), G[1][g] = __ldg(m.input[1] + at);
      z[g] = 0;
    }
  }
  __device__ void advance(double first, double second) {
#pragma unroll
    for (int g = 0; g < group; ++g) z[g] = E[g] * z[g] + (G[0][g] * first + G[1][g] * second);
  }
};

// Both stages of steps j .. j + tile - 1; those past the end repeat the last step.
__device__ void read_steps(const double* column, int step, int j, int last, double (&u)[values_of_tile]) {
#pragma unroll
  for (int i = 0; i < tile; ++i) {
    const long row = 2 * long(min(j + i, last));
    u[2 * i] = column[(row - 1) * step];
    u[2 * i + 1] = column[row * step];
  }
}

// The state that chunk c adds to zero, into added[c]. Every chunk that has a successor is full, a multiple of `tile`.
__global__ void __launch_bounds__(lanes* most_warps)
    accumulate_stages(StageScanTables m, Chunks chunks, const double* y, double* added) {
  let_next_begin();
  const int l = int(blockIdx.x) * lanes + int(threadIdx.x), c = int(blockIdx.y), k0 = int(threadIdx.y) * group;
  const double* const column = y + min(l, m.modes - 1);
  Held held(m, k0, l);
  await_previous();
  for (int j = chunks.begin(c); j < chunks.end(c); j += tile) {
    double u[values_of_tile];
    read_steps(column, m.step, j, chunks.steps, u);
#pragma unroll
    for (int i = 0; i < tile; ++i) held.advance(u[2 * i], u[2 * i + 1]);
  }
#pragma unroll
  for (int g = 0; g < group; ++g) added[(long(c) * m.exponentials + k0 + g) * m.stride + l] = held.z[g];
}

// added[c] <- the state at the start of chunk c, one thread per mode and exponential.
__global__ void carry_stages(StageScanTables m, Chunks chunks, double* added) {
  let_next_begin();
  const long at = long(blockIdx.x) * blockDim.x + threadIdx.x, step = long(m.exponentials) * m.stride;
  const double power = at < step ? __ldg(m.power + at) : 0;
  await_previous();
  if (at >= step) return;
  double z = 0;
#pragma unroll 8
  for (int c = 0; c < chunks.count; ++c) {
    const double more = c + 1 < chunks.count ? added[c * step + at] : 0;
    added[c * step + at] = z;
    z = power * z + more;
  }
}

__global__ void __launch_bounds__(lanes* most_warps)
    apply_stages(StageScanTables m, Chunks chunks, const double* y, const double* states, double* v) {
  extern __shared__ double found[];  // 2 x warps x values_of_tile x lanes
  let_next_begin();
  const int lane = int(threadIdx.x), warp = int(threadIdx.y), warps = int(blockDim.y), k0 = warp * group;
  const int l = int(blockIdx.x) * lanes + lane, c = int(blockIdx.y), end = chunks.end(c);
  const bool given = l < m.modes;
  const double* const column = y + (given ? l : 0);
  Held held(m, k0, l);
  double C[2][group], direct[6];
#pragma unroll
  for (int g = 0; g < group; ++g)
#pragma unroll
    for (int a = 0; a < 2; ++a) C[a][g] = __ldg(m.output[a] + long(k0 + g) * m.stride + l);
#pragma unroll
  for (int i = 0; i < 6; ++i) direct[i] = __ldg(m.direct + i * m.stride + l);
  await_previous();
#pragma unroll
  for (int g = 0; g < group; ++g) held.z[g] = states[(long(c) * m.exponentials + k0 + g) * m.stride + l];
  if (c == 0 && warp == 0 && given) v[l] = 0;
  int half = 0;
  for (int j = chunks.begin(c); j < end; j += tile, half ^= 1) {
    double u[values_of_tile];
    read_steps(column, m.step, j, chunks.steps, u);
    double* const parts = found + half * warps * values_of_tile * lanes + lane;
#pragma unroll
    for (int i = 0; i < tile; ++i) {
      double first = 0, second = 0;
#pragma unroll
      for (int g = 0; g < group; ++g) first += C[0][g] * held.z[g], second += C[1][g] * held.z[g];
      parts[(warp * values_of_tile + 2 * i) * lanes] = first;
      parts[(warp * values_of_tile + 2 * i + 1) * lanes] = second;
      held.advance(u[2 * i], u[2 * i + 1]);
    }
    __syncthreads();  // the other half is still being summed by slower warps
    for (int i = warp; i < values_of_tile; i += warps) {
      const int s = j + i / 2, a = i % 2;
      if (s >= end || !given) continue;
      const double now[2] = {column[(2 * long(s) - 1) * m.step], column[2 * long(s) * m.step]};
      const double before = s > 1 ? column[(2 * long(s) - 2) * m.step] : 0;
      double all = (a ? direct[2] : direct[0]) * now[0] + (a ? direct[3] : direct[1]) * now[1] +
                   (a ? direct[5] : direct[4]) * before;
      for (int w = 0; w < warps; ++w) all += parts[(w * values_of_tile + i) * lanes];
      v[(2 * long(s) - 1 + a) * m.step + l] = all;
    }
  }
}

Index rounded_up(Index count, Index to) { return (count + to - 1) / to * to; }

class StageScan final : public Convolution {
 public:
  StageScan(const Device& device, const StageRecurrence& r, Index rows)
      : device_(device),
        n_(r.modes()),
        K_(rounded_up(std::max<Index>(r.exponentials(), 1), group)),
        stride_(rounded_up(n_, lanes)),
        steps_((rows - 1) / 2),
        length_(chunk_length()),
        chunks_(std::max<Index>(1, (steps_ + length_ - 1) / length_)),
        tables_(on_device(device, tables(r))),
        states_(device, std::size_t(chunks_ * K_ * stride_)) {
    check(cudaFuncSetAttribute(apply_stages, cudaFuncAttributeMaxDynamicSharedMemorySize, int(shared(most_warps))),
          "reserving shared memory");
  }

  void apply(const Array& y, Array& v, Index) override {
    if (steps_ < 1) {
      check(cudaMemsetAsync(values(v), 0, sizeof(double) * std::size_t(n_), device_.stream()), "clearing a row");
      return;
    }
    const auto table = [this](Index i) { return tables_.data() + i * K_ * stride_; };
    const StageScanTables m{table(0), table(1), {table(2), table(3)}, {table(4), table(5)}, table(6),
                            int(K_),  int(n_),  int(stride_),         int(stride(n_))};
    const Chunks chunks{int(chunks_), int(length_), int(steps_)};
    const unsigned across = unsigned(stride_ / lanes), warps = unsigned(K_ / group), each = 256;
    if (chunks_ > 1)
      follow(device_, accumulate_stages, {dim3(across, unsigned(chunks_ - 1)), dim3(lanes, warps)}, starting, m, chunks,
             values(y), states_.data());
    follow(device_, carry_stages, {unsigned((K_ * stride_ + each - 1) / each), each}, starting, m, chunks,
           states_.data());
    follow(device_, apply_stages, {dim3(across, unsigned(chunks_)), dim3(lanes, warps), shared(Index(warps))}, starting,
           m, chunks, values(y), states_.data(), values(v));
  }

  std::size_t bytes() const override { return tables_.bytes() + states_.bytes(); }

 private:
  static std::size_t shared(Index warps) { return sizeof(double) * std::size_t(2 * warps * values_of_tile * lanes); }

  // Tables of StageScanTables, K_ rows each, then six rows.
  RowMatrix tables(const StageRecurrence& r) const {
    RowMatrix all = RowMatrix::Zero(6 * K_ + 6, stride_);
    const auto put = [&](Index row, const auto& values) {
      if (values.size() > 0) all.block(row, 0, values.rows(), n_) = values;
    };
    put(0, r.decay);
    put(K_, entry_powers(r.decay, length_));
    for (int a = 0; a < 2; ++a) {
      put((2 + a) * K_, r.input[a]);
      put((4 + a) * K_, r.output[a]);
      put(6 * K_ + 4 + a, r.w1[a].transpose());
      for (int b = 0; b < 2; ++b) put(6 * K_ + 2 * a + b, r.w0[a][b].transpose());
    }
    return all;
  }

  Index chunk_length() const {
    const Index wanted = wanted_blocks * device_.multiprocessors() * lanes / std::max<Index>(stride_, 1);
    const Index chunks = std::clamp<Index>(wanted, 1, most_chunks);
    return rounded_up(std::max<Index>((steps_ + chunks - 1) / chunks, shortest_chunk), tile);
  }

  const Device& device_;
  Index n_, K_, stride_, steps_, length_, chunks_;
  Memory<double> tables_, states_;
};

}  // namespace

std::unique_ptr<Convolution> make_stage_scan(const Device& device, const StageRecurrence& r, Index rows) {
  if (r.modes() == 0 || r.exponentials() > most_warps * group) return nullptr;
  return std::make_unique<StageScan>(device, r, rows);
}

}  // namespace bromwich::cuda
