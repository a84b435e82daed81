// Causal convolution along time as a recurrence with K exponentials per mode (core/seam/recurrence.hpp), as a chunked
// scan: (1) accumulate: the state that each chunk adds to zero; (2) carry: z at the start of chunk c+1 = E^length z at
// the start of c + what c adds; (3) apply. The states of the chunks are kept, so a later call can begin at any chunk
// whose past has not changed.
//
// Each warp processes 32 neighbouring modes and one chunk, a tile of rows of y in registers at a time. In the first
// pass the exponentials are also divided among warps, `group` each. Three multiply-adds per value and exponential.
//
// Where there are enough modes to fill a device, a warp walks through all chunks instead (convolution_walk.cu): y is
// read once.

#include "kernels/convolution_scan.cuh"
#include "kernels/launch.cuh"
#include "kernels/parts.hpp"

#include <cuda_pipeline_primitives.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace bromwich::cuda {

namespace {

using namespace scan;

constexpr int most_groups = 8;                  ///< per launch; more exponentials are processed in slabs
constexpr int slab_size = most_groups * group;  ///< exponentials
constexpr int together = 4;                     ///< exponentials processed together in the third pass
constexpr int warps_together = 4;               ///< warps per block in the third pass
constexpr Index wanted_warps = 8;               ///< warps per multiprocessor in the third pass
constexpr Index few_chunks = 64;                ///< up to this many chunks, the warps of a block share a chunk
constexpr Index few_blocks = 2;                 ///< same, in blocks per multiprocessor
constexpr int segments = 8, of_segment = 16;    ///< carrying warps, and chunks per warp
constexpr Index most_chunks = segments * of_segment;
constexpr unsigned few_carried = 8;  ///< chunks up to which one thread carries all
constexpr Index starters = 128;      ///< threads per block that sets `initial`
constexpr const char* starting = "starting the scan";

// The state that each chunk adds to zero, into added[c]. Every chunk that has a successor is full.
__global__ void __launch_bounds__(lanes* most_groups) accumulate(Tables m, Span span, const double* y, double* added) {
  let_next_begin();
  const int l = int(blockIdx.x) * lanes + int(threadIdx.x), c = span.from + int(blockIdx.y);
  const int k0 = int(blockIdx.z * blockDim.y + threadIdx.y) * group;
  const double* const column = y + min(l, m.modes - 1);
  const int begin = span.begin(c), end = span.end(c);
  double E[group], z[group], u[tile], next[tile];
#pragma unroll
  for (int g = 0; g < group; ++g) {
    E[g] = k0 < m.count() ? __ldg(m.decay + (k0 + g) * m.stride + l) : 0;
    z[g] = 0;
  }
  await_previous();
  if (k0 >= m.count()) return;
  read_tile(column, m.step, begin, span.rows, next);
  for (int j = begin; j < end; j += tile) {
#pragma unroll
    for (int i = 0; i < tile; ++i) u[i] = next[i];
    if (j + tile < end) read_tile(column, m.step, j + tile, span.rows, next);
#pragma unroll
    for (int i = 0; i < tile; ++i)
#pragma unroll
      for (int g = 0; g < group; ++g) z[g] = E[g] * z[g] + u[i];
  }
#pragma unroll
  for (int g = 0; g < group; ++g) added[(long(c) * m.exponentials + k0 + g) * m.stride + l] = z[g];
}

// One warp per segment of chunks: first what the segment adds to z at its end, then, including the preceding segments,
// z at all chunks.
__global__ void __launch_bounds__(lanes* segments)
    carry(Tables m, Span span, const double* y, const double* added, double* states) {
  __shared__ double ends[segments][lanes];
  let_next_begin();
  const int lane = int(threadIdx.x), segment = int(threadIdx.y), l = int(blockIdx.x) * lanes + lane,
            k = int(blockIdx.y);
  const long at = long(k) * m.stride + l, step = long(m.exponentials) * m.stride;
  const int length = (span.chunks - span.from + segments - 1) / segments, first = span.from + segment * length;
  const double power = __ldg(m.power + at), start = __ldg(m.start + at);
  await_previous();
  if (k >= m.count()) return;
  double z = 0, over = 1, of_chunk[of_segment];
#pragma unroll
  for (int i = 0; i < of_segment; ++i)
    of_chunk[i] = i < length && first + i + 1 < span.chunks ? added[(first + i) * step + at] : 0;
#pragma unroll
  for (int i = 0; i < of_segment; ++i)
    if (i < length) z = power * z + of_chunk[i], over *= power;
  ends[segment][lane] = z;
  z = span.from > 0 ? states[span.from * step + at] : start * y[min(l, m.modes - 1)] + m.initial[at];
  if (span.from == 0 && segment == 0) states[at] = z;
  __syncthreads();
  for (int s = 0; s < segment; ++s) z = over * z + ends[s][lane];
#pragma unroll
  for (int i = 0; i < of_segment; ++i) {
    if (i >= length || first + i + 1 >= span.chunks) return;
    z = power * z + of_chunk[i];
    states[(first + i + 1) * step + at] = z;
  }
}

// The same for few chunks: one thread per mode and exponential, `segments` exponentials per block.
__global__ void __launch_bounds__(lanes* segments)
    carry_few(Tables m, Span span, const double* y, const double* added, double* states) {
  let_next_begin();
  const int l = int(blockIdx.x) * lanes + int(threadIdx.x), k = int(blockIdx.y * segments + threadIdx.y);
  if (k >= m.count()) return;  // rows from there on are not read
  const long at = long(k) * m.stride + l, step = long(m.exponentials) * m.stride;
  const double power = __ldg(m.power + at), start = __ldg(m.start + at);
  await_previous();
  double z = span.from > 0 ? states[span.from * step + at] : start * y[min(l, m.modes - 1)] + m.initial[at];
  if (span.from == 0) states[at] = z;
  for (int c = span.from; c + 1 < span.chunks; ++c) {
    z = power * z + added[c * step + at];
    states[(c + 1) * step + at] = z;
  }
}

/// Shared memory of the third pass, [k][lane] each: decays and outputs common to the chunks of a block, the states of
/// each chunk, and partial sums of warps that share a chunk.
template <int share>
struct Slab {
  static constexpr int chunks = warps_together / share;
  double *decay, *output, *states, *found;
  __device__ Slab(double* shared, int count, int chunk)
      : decay(shared + threadIdx.x),
        output(decay + count * lanes),
        states(output + (1 + chunk) * count * lanes),
        found(output + (1 + chunks) * count * lanes) {}
  static std::size_t bytes(Index count) {
    return sizeof(double) * std::size_t(((2 + chunks) * count + (share > 1 ? share * tile : 0)) * lanes);
  }
};

// The contribution of the exponentials of a warp to a tile, summed in two parts; advances the states of the chunk.
template <int share>
__device__ __forceinline__ void add_exponentials(const Slab<share>& own, int part, int count, const double (&u)[tile],
                                                 double (&even)[tile], double (&odd)[tile]) {
#pragma unroll 1
  for (int k = part * together; k < count; k += share * together) {
    double E[together], C[together], z[together];
#pragma unroll
    for (int g = 0; g < together; ++g) {
      E[g] = own.decay[(k + g) * lanes], C[g] = own.output[(k + g) * lanes];
      z[g] = own.states[(k + g) * lanes];
    }
#pragma unroll
    for (int i = 0; i < tile; ++i)
#pragma unroll
      for (int g = 0; g < together; ++g) {
        (g % 2 == 0 ? even[i] : odd[i]) += C[g] * z[g];
        z[g] = E[g] * z[g] + u[i];
      }
#pragma unroll
    for (int g = 0; g < together; ++g) own.states[(k + g) * lanes] = z[g];
  }
}

// Exponentials from slab * slab_size on. The first slab writes v, the others add to it. `share` warps process a chunk
// together and take its exponentials in turn: 1, or all warps of a block.
template <int share>
__global__ void __launch_bounds__(lanes* warps_together)
    apply_chunks(Tables m, Span span, int slab, const double* y, const double* states, double* v) {
  static_assert(share == 1 || share == warps_together);
  extern __shared__ double shared[];
  let_next_begin();
  const int warp = int(threadIdx.y), part = warp % share, l = int(blockIdx.x) * lanes + int(threadIdx.x);
  const int c = span.from + int(blockIdx.y) * Slab<share>::chunks + warp / share;
  const int first = slab * slab_size, count = min(slab_size, m.count() - first);
  const Slab<share> own(shared, count, warp / share);
  const long at = long(first) * m.stride + l, of_chunk = long(c) * m.exponentials * m.stride + at;
  for (int k = warp; k < count; k += warps_together) {
    __pipeline_memcpy_async(own.decay + k * lanes, m.decay + at + k * m.stride, 8);
    __pipeline_memcpy_async(own.output + k * lanes, m.output + at + k * m.stride, 8);
  }
  const bool given = l < m.modes;
  const double w0 = given ? __ldg(m.w0 + l) : 0, w1 = given ? __ldg(m.w1 + l) : 0, s1 = given ? __ldg(m.s1 + l) : 0;
  await_previous();
  for (int k = part; c < span.chunks && k < count; k += share)
    __pipeline_memcpy_async(own.states + k * lanes, states + of_chunk + k * m.stride, 8);
  __pipeline_commit();
  const double* const column = y + (given ? l : 0);
  double* const out = v + (given ? l : 0);
  const int begin = span.begin(c), end = c < span.chunks ? span.end(c) : begin;
  if (c == 0 && slab == 0 && part == 0 && given) out[0] = 0;
  double before = column[long(min(begin, span.rows) - 1) * m.step];
  double u[tile];
  read_tile(column, m.step, begin, span.rows, u);
  __pipeline_wait_prior(0);
  __syncthreads();
  for (int j = begin; j < end; j += tile) {
    double even[tile], odd[tile];
#pragma unroll
    for (int i = 0; i < tile; ++i) {
      const bool adds = part == 0 && slab > 0, begins = part == 0 && slab == 0;
      even[i] = adds ? out[long(min(j + i, span.rows - 1)) * m.step] : begins ? w0 * u[i] : 0;
      odd[i] = begins ? (i == 0 && j == 1 ? s1 : w1) * (i > 0 ? u[i > 0 ? i - 1 : 0] : before) : 0;
    }
    add_exponentials<share>(own, part, count, u, even, odd);
    before = u[tile - 1];
    if (j + tile < end) read_tile(column, m.step, j + tile, span.rows, u);
    if constexpr (share == 1) {
#pragma unroll
      for (int i = 0; i < tile; ++i)
        if (given && j + i < end) out[long(j + i) * m.step] = even[i] + odd[i];
    } else {
#pragma unroll
      for (int i = 0; i < tile; ++i) own.found[(part * tile + i) * lanes] = even[i] + odd[i];
      __syncthreads();
      for (int i = part; i < tile; i += share) {
        double all = 0;
#pragma unroll
        for (int p = 0; p < share; ++p) all += own.found[(p * tile + i) * lanes];
        if (given && j + i < end) out[long(j + i) * m.step] = all;
      }
      __syncthreads();
    }
  }
}

// initial <- D E / C, one row of blocks per exponential.
__global__ void set_initial(const double* D, int step, int modes, int stride, const double* decay, const double* output,
                            double* initial) {
  const int l = int(blockIdx.x * blockDim.x + threadIdx.x);
  if (l >= modes) return;
  const long at = long(blockIdx.y) * stride + l;
  initial[at] = decay[at] == 0 ? 0 : D[long(blockIdx.y) * step + l] * decay[at] / output[at];
}

Index rounded_up(Index n, Index to) { return (n + to - 1) / to * to; }

class ModalScan final : public Scan {
 public:
  /// `counts`: exponentials of each group of modes, the others being zero; empty: all. `shells`: null, or what brings
  /// the recurrence into these groups.
  ModalScan(const Device& device, const ModalRecurrence& r, Index modes, Index rows, const std::vector<int>& counts,
            const Shells* shells)
      : device_(device),
        total_(r.modes()),
        n_(modes),
        K_(rounded_up(std::max<Index>(r.exponentials(), 1), group)),
        stride_(rounded_up(n_, lanes)),
        shared_(stride_ / lanes * few_chunks <= few_blocks * device.multiprocessors()),
        length_(chunk_length(rows)),
        chunks_(std::max<Index>(1, (rows - 1 + length_ - 1) / length_)),
        rows_(rows),
        tables_(form_tables(device, r, shells, {n_, K_, stride_, length_})),
        counts_(device, counts.size()),
        states_(device, std::size_t(chunks_ * K_ * stride_)),
        added_(device, Walk::suits(device, n_, K_) ? 0 : std::size_t(chunks_ * K_ * stride_)) {
    if (!counts.empty()) counts_.put(counts.data());
    if (Walk::suits(device, n_, K_))
      walk_.emplace(device, counts.empty() ? std::vector<int>(std::size_t(stride_ / lanes), int(K_)) : counts);
    reserve<1>();
    reserve<warps_together>();
    if (n_ == total_ && !shells) start_from = [this](const Array& D) { take_start(D); };
  }

  void apply(const Array& y, Array& v, Index first) override {
    const Index from = std::max<Index>(first - 1, 0) / length_;
    if (rows_ < 2)
      check(cudaMemsetAsync(values(v), 0, sizeof(double) * std::size_t(n_), device_.stream()), "clearing a row");
    if (rows_ < 2 || from >= chunks_) return;
    const Tables m = tables();
    const Span span{int(from), int(chunks_), int(length_), int(rows_)};
    if (walk_) return walk_->run(m, span, values(y), states_.data(), values(v));
    const unsigned across = unsigned(stride_ / lanes), along = unsigned(chunks_ - from),
                   slabs = unsigned(rounded_up(K_, slab_size) / slab_size);
    if (!std::exchange(accumulated_, false)) add_up(m, span, y);
    const unsigned together_k = unsigned(rounded_up(K_, segments) / segments);
    if (along <= few_carried)
      follow(device_, carry_few, {dim3(across, together_k), dim3(lanes, segments)}, starting, m, span, values(y),
             added_.data(), states_.data());
    else
      follow(device_, carry, {dim3(across, unsigned(K_)), dim3(lanes, segments)}, starting, m, span, values(y),
             added_.data(), states_.data());
    for (unsigned slab = 0; slab < slabs; ++slab)
      shared_ ? start<warps_together>(m, span, slab, y, v) : start<1>(m, span, slab, y, v);
  }

  void take_start(const Array& D) {
    const dim3 blocks(unsigned((n_ + starters - 1) / starters), unsigned(D.rows()));
    set_initial<<<blocks, starters, 0, device_.stream()>>>(values(D), int(stride(n_)), int(n_), int(stride_),
                                                           tables_.data(), tables_.data() + 2 * K_ * stride_,
                                                           tables_.data() + 4 * K_ * stride_);
    check(cudaGetLastError(), starting);
    device_.note_work();
  }

  std::optional<Chunks> add_up_chunks(const Array& y) override {
    if (walk_ || chunks_ > few_carried || rows_ < 2) return std::nullopt;
    const Span span{0, int(chunks_), int(length_), int(rows_)};
    add_up(tables(), span, y);
    accumulated_ = true;
    return Chunks{span, added_.data()};
  }

  Tables tables() const override {
    const auto table = [this](Index i) { return tables_.data() + i * K_ * stride_; };
    const double* const w0 = table(5);
    return {table(0),
            table(1),
            table(2),
            table(3),
            table(4),
            w0,
            w0 + stride_,
            w0 + 2 * stride_,
            int(K_),
            int(n_),
            int(stride_),
            counts_.size() > 0 ? counts_.data() : nullptr,
            int(stride(total_))};
  }
  double* initial() override { return tables_.data() + 4 * K_ * stride_; }

  std::size_t bytes() const override {
    return tables_.bytes() + states_.bytes() + added_.bytes() + (walk_ ? walk_->bytes() : 0);
  }

 private:
  template <int share>
  void reserve() const {
    check(cudaFuncSetAttribute(apply_chunks<share>, cudaFuncAttributeMaxDynamicSharedMemorySize,
                               int(Slab<share>::bytes(slab_size))),
          "reserving shared memory");
  }

  // What chunks with a successor add.
  void add_up(const Tables& m, const Span& span, const Array& y) {
    const unsigned along = unsigned(span.chunks - span.from), slabs = unsigned(rounded_up(K_, slab_size) / slab_size),
                   groups = unsigned(std::min<Index>(K_ / group, most_groups));
    if (along > 1)
      follow(device_, accumulate, {dim3(unsigned(stride_ / lanes), along - 1, slabs), dim3(lanes, groups)}, starting, m,
             span, values(y), added_.data());
  }

  template <int share>
  void start(const Tables& m, const Span& span, unsigned slab, const Array& y, Array& v) const {
    const Index along = span.chunks - span.from, chunks = Slab<share>::chunks;
    const dim3 blocks(unsigned(stride_ / lanes), unsigned((along + chunks - 1) / chunks));
    const std::size_t bytes = Slab<share>::bytes(std::min<Index>(K_ - slab * slab_size, slab_size));
    follow(device_, apply_chunks<share>, {blocks, dim3(lanes, warps_together), bytes}, starting, m, span, int(slab),
           values(y), states_.data(), values(v));
  }

  // Enough warps to hide latency; the carry pass is cheap for few chunks.
  Index chunk_length(Index rows) const {
    const Index most = shared_ ? few_chunks : most_chunks;
    const Index wanted = std::max<Index>(wanted_warps * device_.multiprocessors() * lanes / stride_, warps_together);
    const Index chunks = std::min(wanted, most);  // a block has `warps_together` of them
    return rounded_up(std::max<Index>((rows - 1 + chunks - 1) / chunks, 2 * tile), tile);
  }

  const Device& device_;
  Index total_, n_, K_, stride_;  ///< this plan computes modes 0 .. n_ - 1
  bool shared_;                   ///< few modes: the warps of a block share a chunk
  Index length_, chunks_, rows_;
  Memory<double> tables_, states_, added_;
  Memory<int> counts_;
  std::optional<Walk> walk_;  ///< many modes: a warp takes all chunks
  bool accumulated_ = false;  ///< the states that chunks add are those of the next y
};

}  // namespace

std::unique_ptr<Scan> scan::make_scan(const Device& device, const ModalRecurrence& r, Index modes, Index rows,
                                      const std::vector<int>& counts) {
  return std::make_unique<ModalScan>(device, r, modes, rows, counts, nullptr);
}

std::unique_ptr<Scan> scan::make_scan(const Device& device, const ModalRecurrence& r, const Shells& shells,
                                      Index rows) {
  return std::make_unique<ModalScan>(device, r, r.modes(), rows, counts_of(shells), &shells);
}

std::unique_ptr<Convolution> make_modal_scan(const Device& device, const ModalRecurrence& r, Index modes, Index rows) {
  return scan::make_scan(device, r, modes, rows, {});
}

}  // namespace bromwich::cuda
