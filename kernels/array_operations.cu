// Operations on whole arrays that a hierarchy of time grids needs, and looks at a solution: one pass over memory each,
// a thread per number where nothing else is said.
// Rows keep their stride; what lies between them stays zero.

#include "kernels/launch.cuh"
#include "kernels/lcp_batch.hpp"
#include "kernels/lcp_outcome.cuh"
#include "kernels/parts.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich::cuda {

namespace {

constexpr int threads = 256;
constexpr Index most_blocks = 1 << 16;
constexpr int chunk = 64;  ///< rows

unsigned blocks(Index values) { return unsigned(std::min((values + threads - 1) / threads, most_blocks)); }

__device__ long first_value() { return blockIdx.x * long(blockDim.x) + threadIdx.x; }
__device__ long all_threads() { return gridDim.x * long(blockDim.x); }

__global__ void take_rows(const double* fine, long ratio, long step, long values, double* coarse) {
  let_next_begin();
  await_previous();
  for (long i = first_value(); i < values; i += all_threads()) {
    const long row = i / step, column = i - row * step;
    coarse[i] = fine[row * ratio * step + column];
  }
}

// A thread per number of the fine array: row j = R i + k lies between the rows i and i + 1 of the coarse one.
__global__ void add_interpolation(const double* coarse, const double* old, long ratio, long step, long values,
                                  double* fine) {
  let_next_begin();
  await_previous();
  for (long i = first_value(); i < values; i += all_threads()) {
    const long row = i / step, column = i - row * step, above = row / ratio, between = row - above * ratio;
    const long left = above * step + column, right = between > 0 ? left + step : left;
    const double at_left = coarse[left] - (old ? old[left] : 0);
    const double at_right = coarse[right] - (old ? old[right] : 0);
    fine[i] += at_left + double(between) / double(ratio) * (at_right - at_left);
  }
}

__global__ void pose(const double* r, const double* v, const double* y, const double* coarse_v, long ratio, long step,
                     long values, double* coarse_r, double* coarse_y, double* old) {
  let_next_begin();
  await_previous();
  for (long i = first_value(); i < values; i += all_threads()) {
    const long fine = i + i / step * (ratio - 1) * step;
    coarse_r[i] = r[fine] + v[fine] - coarse_v[i];
    coarse_y[i] = old[i] = y[fine];
  }
}

__global__ void add_multiple(const double* b, double s, const double* c, long values, double* a) {
  let_next_begin();
  await_previous();
  for (long i = first_value(); i < values; i += all_threads()) a[i] = b[i] + s * c[i];
}

// A warp per row; the largest of all rows goes to `out`, a NaN as one.
__global__ void differences(const double* a, const double* b, int rows, int cols, int step, double* out) {
  let_next_begin();
  await_previous();
  const int row = int(blockIdx.x) * int(blockDim.y) + int(threadIdx.y);
  if (row >= rows) return;  // the same for all lanes of the warp
  const double* const p = a + long(row) * step;
  const double* const q = b + long(row) * step;
  double gap = 0, size = 1;
  for (int i = int(threadIdx.x); i < cols; i += 32) {
    gap = larger(fabs(p[i] - q[i]), gap);
    size = fmax(size, fabs(p[i]));
  }
  for (int lane = 16; lane > 0; lane /= 2) {
    gap = larger(__shfl_xor_sync(~0u, gap, lane), gap);
    size = fmax(size, __shfl_xor_sync(~0u, size, lane));
  }
  if (threadIdx.x == 0) atomicMax(reinterpret_cast<unsigned long long*>(out), bits(gap / size));
}

// A thread per column and chunk of rows, as in all below.
__device__ int first_row(int begin) { return begin + int(blockIdx.x) * chunk; }
__device__ int column() { return int(blockIdx.y * blockDim.x + threadIdx.x); }

__global__ void largest_of_columns(const double* y, int rows, int cols, int step, double* largest) {
  if (column() >= cols) return;
  double mine = 0;
  const int first = first_row(0), last = min(rows, first + chunk);
#pragma unroll 8
  for (int j = first; j < last; ++j) mine = fmax(mine, fabs(y[long(j) * step + column()]));
  atomicMax(reinterpret_cast<unsigned long long*>(largest + column()), bits(mine));
}

// Runs that end in the chunk: it begins so many rows before.
__global__ void find_alternation(const double* y, int rows, int cols, int step, int run, double part,
                                 const double* largest, int* found) {
  if (column() >= cols) return;
  const double least = part * largest[column()];
  const int begin = first_row(1), end = min(rows - 1, begin + chunk), first = max(1, begin - run);
  const double* const at = y + column();
  if (begin >= end) return;
  double above = at[long(first - 1) * step], here = at[long(first) * step], before = 0;
  int length = 0;
#pragma unroll 8
  for (int j = first; j < end; ++j) {
    const double below = at[long(j + 1) * step], bend = above - 2 * here + below;
    length = fabs(bend) > least && bend * before < 0 ? length + 1 : 0;
    if (length >= run) *found = 1;
    above = here, here = below, before = bend;
  }
}

Index values_of(const Array& array) { return array.rows() * stride(array.cols()); }
Index ratio(const Array& fine, const Array& coarse) { return (fine.rows() - 1) / (coarse.rows() - 1); }

}  // namespace

void inject(const Device& device, const Array& fine, Array& coarse) {
  const Index size = values_of(coarse);
  follow(device, take_rows, {blocks(size), threads}, "starting an injection", values(fine), ratio(fine, coarse),
         stride(coarse.cols()), size, values(coarse));
}

void interpolate(const Device& device, const Array& coarse, const Array* old, Array& fine) {
  const Index size = values_of(fine);
  follow(device, add_interpolation, {blocks(size), threads}, "starting an interpolation", values(coarse),
         old ? values(*old) : nullptr, ratio(fine, coarse), stride(fine.cols()), size, values(fine));
}

void restrict_problem(const Device& device, const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                      Array& coarse_r, Array& coarse_y, Array& old) {
  const Index size = values_of(coarse_y);
  follow(device, pose, {blocks(size), threads}, "posing a coarse problem", values(r), values(v), values(y),
         values(coarse_v), ratio(y, coarse_y), stride(coarse_y.cols()), size, values(coarse_r), values(coarse_y),
         values(old));
}

void add(const Device& device, const Array& b, double s, const Array& c, Array& a) {
  const Index size = values_of(a);
  follow(device, add_multiple, {blocks(size), threads}, "starting a sum of arrays", values(b), s, values(c), size,
         values(a));
}

namespace {

class QueuedDifferences final : public Differences {
 public:
  QueuedDifferences(const Device& device, Backend& backend, std::size_t slots)
      : Differences(backend, slots), device_(device), found_(device, slots) {
    found_.clear();
  }

  void start(std::size_t slot, const Array& a, const Array& b) override {
    double* const out = found_.data() + slot;
    check(cudaMemsetAsync(out, 0, sizeof(double), device_.stream()), "starting a difference of arrays");
    follow(device_, differences, {unsigned((a.rows() + 7) / 8), dim3(32, 8)}, "starting a difference of arrays",
           values(a), values(b), int(a.rows()), int(a.cols()), int(stride(a.cols())), out);
    fresh_ = true;
  }

  const std::vector<double>& collect() override {
    if (!fresh_) return values_;
    found_.get(values_.data());
    for (double& value : values_)
      if (!std::isfinite(value)) value = NAN;
    fresh_ = false;
    return values_;
  }

 private:
  const Device& device_;
  Memory<double> found_;
  bool fresh_ = false;
};

}  // namespace

std::unique_ptr<Differences> make_differences(const Device& device, Backend& backend, std::size_t slots) {
  return std::make_unique<QueuedDifferences>(device, backend, slots);
}

bool alternates(const Device& device, const Array& y, Index run, double part) {
  const Index rows = y.rows(), cols = y.cols();
  if (rows < 3 || cols == 0) return false;
  Memory<double> largest(device, std::size_t(cols));
  Memory<int> found(device, 1);
  largest.clear();
  found.clear();
  const Index chunks = (rows + chunk - 1) / chunk;
  const dim3 blocks(unsigned(chunks), unsigned((cols + threads - 1) / threads));
  largest_of_columns<<<blocks, threads, 0, device.stream()>>>(values(y), int(rows), int(cols), int(stride(cols)),
                                                              largest.data());
  find_alternation<<<blocks, threads, 0, device.stream()>>>(values(y), int(rows), int(cols), int(stride(cols)),
                                                            int(run), part, largest.data(), found.data());
  check(cudaGetLastError(), "looking for alternating values");
  int answer = 0;
  found.get(&answer);
  return answer != 0;
}

}  // namespace bromwich::cuda
