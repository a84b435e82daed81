// A scan whose rows follow those of other ranks (core/seam/slab_operations.hpp). A state holds, group of modes by
// group, the exponentials that the group has, 32 modes side by side: what a slab leaves is small where modes forget
// fast.
//
// The state at the end of a slab comes from what the chunks of a scan add, which the scan itself needs next. In a walk,
// or a scan of many chunks, it is summed up apart, over as many of the last rows as a group of modes remembers: they
// are divided among the warps of a block, whose sums are then brought together, z <- E^length z + z of the next warp.

#include "kernels/convolution_scan.cuh"
#include "kernels/launch.cuh"
#include "kernels/parts.hpp"
#include "ranks/slab_states.hpp"

#include <algorithm>
#include <utility>
#include <vector>

namespace bromwich::cuda {

namespace {

using namespace scan;

constexpr int warps = group;  ///< of a block: the sums of one exponential each are brought together by one warp
constexpr int adders = 128;   ///< threads of a block
constexpr const char* taking = "taking a state";

// One block for `group` exponentials of `lanes` modes. Rows 1 .. last; `known` of them are remembered. `ahead`: the
// next tile is read while one is summed up, where there are too few blocks to hide the time of a read.
template <bool ahead>
__global__ void __launch_bounds__(lanes* warps)
    take_state(Tables m, const int* offsets, const int* known, int last, bool first_rank, const double* y, double* to) {
  __shared__ double sums[warps][group][lanes];
  let_next_begin();
  const int lane = int(threadIdx.x), warp = int(threadIdx.y), l = int(blockIdx.x) * lanes + lane;
  const int k0 = int(blockIdx.y) * group, column = min(l, m.modes - 1);
  if (k0 >= m.count()) return;  // the whole block
  const int remembered = known[blockIdx.x], length = ((remembered + warps - 1) / warps + tile - 1) / tile * tile;
  double E[group], z[group];
#pragma unroll
  for (int g = 0; g < group; ++g) {
    E[g] = __ldg(m.decay + (k0 + g) * m.stride + l);
    z[g] = 0;
  }
  await_previous();
  const int end = last - (warps - 1 - warp) * length, begin = max(end - length, last - remembered) + 1;
  if (first_rank && begin == 1 && end >= 1) {
#pragma unroll
    for (int g = 0; g < group; ++g) {
      const long at = long(k0 + g) * m.stride + l;
      z[g] = m.start[at] * y[column] + m.initial[at];
    }
  }
  int j = begin;
  for (; (end - j + 1) % tile != 0 && j <= end; ++j) {
    const double u = y[long(j) * m.step + column];
#pragma unroll
    for (int g = 0; g < group; ++g) z[g] = E[g] * z[g] + u;
  }
  double u[tile], next[tile];
  if (ahead && j <= end) read_tile(y + column, m.step, j, last + 1, next);
  for (; j <= end; j += tile) {
    if constexpr (ahead) {
#pragma unroll
      for (int i = 0; i < tile; ++i) u[i] = next[i];
      if (j + tile <= end) read_tile(y + column, m.step, j + tile, last + 1, next);
    } else {
      read_tile(y + column, m.step, j, last + 1, u);
    }
#pragma unroll
    for (int i = 0; i < tile; ++i)
#pragma unroll
      for (int g = 0; g < group; ++g) z[g] = E[g] * z[g] + u[i];
  }
#pragma unroll
  for (int g = 0; g < group; ++g) sums[warp][g][lane] = z[g];
  __syncthreads();
  const double over = power(__ldg(m.decay + (k0 + warp) * m.stride + l), length);
  double all = 0;
  for (int w = 0; w < warps; ++w) all = over * all + sums[w][warp][lane];
  to[offsets[blockIdx.x] + (k0 + warp) * lanes + lane] = l < m.modes ? all : 0;
}

// What the last chunk, which need not be full, adds to zero.
__global__ void __launch_bounds__(lanes* warps) add_last_chunk(Tables m, Span span, const double* y, double* added) {
  let_next_begin();
  const int l = int(blockIdx.x) * lanes + int(threadIdx.x), c = span.chunks - 1;
  const int k0 = int(blockIdx.y * warps + threadIdx.y) * group;
  const double* const column = y + min(l, m.modes - 1);
  await_previous();
  if (k0 >= m.count()) return;
  double E[group], z[group];
#pragma unroll
  for (int g = 0; g < group; ++g) {
    E[g] = m.decay[(k0 + g) * m.stride + l];
    z[g] = 0;
  }
  for (int j = span.begin(c), end = span.end(c); j < end; j += tile) {
    double u[tile];
    read_tile(column, m.step, j, span.rows, u);
#pragma unroll
    for (int i = 0; i < tile; ++i)
      if (j + i < end) {
#pragma unroll
        for (int g = 0; g < group; ++g) z[g] = E[g] * z[g] + u[i];
      }
  }
#pragma unroll
  for (int g = 0; g < group; ++g) added[(long(c) * m.exponentials + k0 + g) * m.stride + l] = z[g];
}

// The state after the last chunk, from what each of them adds. One thread for an exponential of a mode.
__global__ void __launch_bounds__(lanes* warps) sum_chunks(Tables m, Span span, const int* offsets, bool first_rank,
                                                           const double* y, const double* added, double* to) {
  let_next_begin();
  const int l = int(blockIdx.x) * lanes + int(threadIdx.x), k = int(blockIdx.y) * group + int(threadIdx.y);
  if (k >= m.count()) return;
  const long at = long(k) * m.stride + l, step = long(m.exponentials) * m.stride;
  const double over = __ldg(m.power + at),
               over_last = power(__ldg(m.decay + at), span.rows - span.begin(span.chunks - 1));
  await_previous();
  double z = first_rank ? m.start[at] * y[min(l, m.modes - 1)] + m.initial[at] : 0;
  for (int c = 0; c + 1 < span.chunks; ++c) z = over * z + added[c * step + at];
  z = over_last * z + added[(span.chunks - 1) * step + at];
  to[offsets[blockIdx.x] + k * lanes + int(threadIdx.x)] = l < m.modes ? z : 0;
}

__global__ void __launch_bounds__(lanes* warps)
    give_state(Tables m, const int* offsets, const double* from, double* initial) {
  let_next_begin();
  await_previous();
  const int k = int(blockIdx.y) * group + int(threadIdx.y), l = int(blockIdx.x) * lanes + int(threadIdx.x);
  if (k < m.count()) initial[long(k) * m.stride + l] = from[offsets[blockIdx.x] + k * lanes + int(threadIdx.x)];
}

__global__ void pick(const double* state, const int* which, int count, double* to) {
  let_next_begin();
  await_previous();
  const int i = int(blockIdx.x * blockDim.x + threadIdx.x);
  if (i < count) to[i] = state[which[i]];
}

// What ranks 0 .. before - 1 have left, decayed.
__global__ void add_earlier(const double* of_all, int step, int before, const double* powers, const int* places,
                            int count, double* initial) {
  let_next_begin();
  await_previous();
  const int i = int(blockIdx.x * blockDim.x + threadIdx.x);
  if (i >= count) return;
  double sum = 0;
  for (int r = 0; r < before; ++r) sum += powers[long(r) * count + i] * of_all[long(r) * step + i];
  initial[places[i]] += sum;
}

Memory<int> on_device(const Device& device, const std::vector<int>& values) {
  Memory<int> memory(device, values.size());
  memory.put(values.data());
  return memory;
}

/// What the constructor needs of the recurrence.
struct Layout {
  ModalRecurrence recurrence;
  std::vector<int> counts;
  std::vector<int> offsets, known;  ///< of each group: its first value in a state, and the rows that it remembers
  std::vector<int> places;          ///< of each value of a state in a K x stride table
  RowMatrix decay;                  ///< of each value of a state, 1 x values

  Layout(const Device& device, const ModalRecurrence& r, Index steps, Index last, Index stride) : recurrence(r) {
    if (r.initial.size() == 0 && r.face.size() > 1) {
      const Shells shells = find_shells(DeviceThreads(device), r, steps, lanes, group);
      recurrence = in_shells(r, shells);
      counts = counts_of(shells);
    }
    const RowMatrix& E = recurrence.decay;
    const Index groups = (r.modes() + lanes - 1) / lanes,
                K = (std::max<Index>(E.rows(), 1) + group - 1) / group * group;
    std::vector<double> decays;
    for (Index g = 0; g < groups; ++g) {
      offsets.push_back(int(places.size()));
      const Index count = counts.empty() ? K : counts[std::size_t(g)];
      double slowest = 0;
      for (Index k = 0; k < count; ++k)
        for (Index lane = 0; lane < lanes; ++lane) {
          const Index l = g * lanes + lane;
          places.push_back(int(k * stride + l));
          decays.push_back(k < E.rows() && l < r.modes() ? E(k, l) : 0);
          slowest = std::max(slowest, std::abs(decays.back()));
        }
      known.push_back(int(remembered(slowest, last)));
    }
    decay = Eigen::Map<const RowMatrix>(decays.data(), 1, Index(decays.size()));
  }
};

class CarriedScan final : public CarriedConvolution {
 public:
  CarriedScan(const Device& device, const ModalRecurrence& r, const Layout& layout, const Outliving& outliving,
              Index rows, int rank)
      : CarriedConvolution(Index(layout.places.size()), Index(outliving.values.size())),
        device_(device),
        rank_(rank),
        last_(int(rows) - 1),
        groups_(unsigned(layout.offsets.size())),
        scan_(make_scan(device, of_rank(layout.recurrence, rank == 0), r.modes(), rows, layout.counts)),
        offsets_(on_device(device, layout.offsets)),
        known_(on_device(device, layout.known)),
        powers_(cuda::on_device(device, outliving.powers)) {
    std::vector<int> which, places;
    for (const Index value : outliving.values) {
      which.push_back(int(value));
      places.push_back(layout.places[std::size_t(value)]);
    }
    which_ = on_device(device, which);
    places_ = on_device(device, places);
    if (rank == 0) start_from = [this](const Array& D) { scan_->start_from(D); };
  }

  void leave(const Array& y, Array& to, Array* outliving) override {
    const Tables m = scan_->tables();
    if (const auto chunks = scan_->add_up_chunks(y)) {  // the scan needs all but the last of them anyway
      const unsigned groups = unsigned((m.exponentials / group + warps - 1) / warps);
      follow(device_, add_last_chunk, {dim3(groups_, groups), dim3(lanes, warps)}, taking, m, chunks->span, values(y),
             chunks->added);
      follow(device_, sum_chunks, {across(m), dim3(lanes, warps)}, taking, m, chunks->span, offsets_.data(), rank_ == 0,
             values(y), chunks->added, values(to));
    } else {
      const bool few = groups_ * unsigned(m.exponentials / group) <= unsigned(2 * device_.multiprocessors());
      follow(device_, few ? take_state<true> : take_state<false>, {across(m), dim3(lanes, warps)}, taking, m,
             offsets_.data(), known_.data(), last_, rank_ == 0, values(y), values(to));
    }
    if (outliving)
      follow(device_, pick, {blocks(), adders}, taking, values(to), which_.data(), int(lasting), values(*outliving));
  }

  void begin(const Array& left, const Array* of_all) override {
    const Tables m = scan_->tables();
    follow(device_, give_state, {across(m), dim3(lanes, warps)}, "giving a state", m, offsets_.data(), values(left),
           scan_->initial());
    if (of_all && rank_ > 1)
      follow(device_, add_earlier, {blocks(), adders}, "giving a state", values(*of_all), int(stride(of_all->cols())),
             rank_ - 1, powers_.data(), places_.data(), int(lasting), scan_->initial());
  }

  void apply(const Array& y, Array& v, Index first) override { scan_->apply(y, v, first); }

  std::size_t bytes() const override {
    return scan_->bytes() + offsets_.bytes() + known_.bytes() + which_.bytes() + places_.bytes() + powers_.bytes();
  }

 private:
  dim3 across(const Tables& m) const { return {groups_, unsigned(m.exponentials / group)}; }
  unsigned blocks() const { return unsigned((lasting + adders - 1) / adders); }

  const Device& device_;
  int rank_, last_;
  unsigned groups_;
  std::unique_ptr<Scan> scan_;
  Memory<int> offsets_, known_, which_, places_;
  Memory<double> powers_;
};

}  // namespace

std::unique_ptr<CarriedConvolution> make_carried_scan(const Device& device, const ModalRecurrence& r,
                                                      const std::vector<Index>& ends, int rank) {
  const Index rows = ends[std::size_t(rank) + 1] - ends[std::size_t(rank)] + 1;
  const Index stride_of_tables = (r.modes() + lanes - 1) / lanes * lanes;
  const Layout layout(device, r, ends.back(), rows - 1, stride_of_tables);
  return std::make_unique<CarriedScan>(device, r, layout, outliving(layout.decay, ends, rank), rows, rank);
}

}  // namespace bromwich::cuda
