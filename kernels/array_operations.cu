// Operations on whole arrays for the hierarchy of time grids and for tests of a solution. Each is one pass over memory,
// one thread per value unless stated otherwise. The padding between rows stays zero.

#include "kernels/launch.cuh"
#include "kernels/lcp_batch.hpp"
#include "kernels/lcp_outcome.cuh"
#include "kernels/parts.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich::cuda {

namespace {

constexpr int threads = 256;
constexpr Index most_blocks = 1 << 16;
constexpr int chunk = 64;  ///< rows

unsigned blocks(Index values) { return unsigned(std::min((values + threads - 1) / threads, most_blocks)); }

__device__ long first_value() { return blockIdx.x * long(blockDim.x) + threadIdx.x; }
__device__ long all_threads() { return gridDim.x * long(blockDim.x); }

__device__ double2 operator+(double2 a, double2 b) { return {a.x + b.x, a.y + b.y}; }
__device__ double2 operator-(double2 a, double2 b) { return {a.x - b.x, a.y - b.y}; }
__device__ double2 operator*(double s, double2 a) { return {s * a.x, s * a.y}; }

/// One thread per value of `rows` rows of `width` values. A Value is one number, or two if rows are wide enough.
struct Rows {
  int rows, width;
  __device__ int row() const { return int(blockIdx.x * blockDim.y + threadIdx.y); }
  __device__ int column() const { return int(blockIdx.y * blockDim.x + threadIdx.x); }
  __device__ bool has_thread() const { return row() < rows && column() < width; }
  __device__ long at(long row) const { return row * width + column(); }
};

template <class Value>
__global__ void take_rows(Rows rows, const Value* fine, int ratio, Value* coarse) {
  let_next_begin();
  await_previous();
  if (rows.has_thread()) coarse[rows.at(rows.row())] = fine[rows.at(long(rows.row()) * ratio)];
}

// One thread per value of coarse row i; it updates the `ratio` fine rows up to the next coarse row.
template <class Value>
__global__ void add_interpolation(Rows rows, const Value* coarse, const Value* old, int ratio, Value* fine) {
  let_next_begin();
  await_previous();
  if (!rows.has_thread()) return;
  const int i = rows.row(), count = i + 1 < rows.rows ? ratio : 1;
  const long left = rows.at(i), right = rows.at(count > 1 ? i + 1 : i), first = rows.at(long(ratio) * i);
  Value at_left = coarse[left], step = coarse[right];
  if (old) at_left = at_left - old[left], step = step - old[right];
  step = 1.0 / double(ratio) * (step - at_left);
  for (int k = 0; k < count; ++k) {
    Value& value = fine[first + long(k) * rows.width];
    value = value + (at_left + double(k) * step);
  }
}

template <class Value>
__global__ void pose(Rows rows, const Value* r, const Value* v, const Value* y, const Value* coarse_v, int ratio,
                     Value* coarse_r, Value* coarse_y, Value* old) {
  let_next_begin();
  await_previous();
  if (!rows.has_thread()) return;
  const long i = rows.at(rows.row()), fine = rows.at(long(rows.row()) * ratio);
  const Value value = y[fine];
  coarse_r[i] = r[fine] + v[fine] - coarse_v[i];
  coarse_y[i] = old[i] = value;
}

// One thread per value of row j of both parts; rows 2j - 1 and 2j of `stages`, none before row 0.
template <class Value>
__global__ void split_stages(Rows rows, const Value* stages, Value* first, Value* second) {
  let_next_begin();
  await_previous();
  if (!rows.has_thread()) return;
  const long at = rows.at(rows.row()), end = rows.at(2 * long(rows.row()));
  first[at] = rows.row() > 0 ? stages[rows.at(2 * long(rows.row()) - 1)] : Value{};
  second[at] = stages[end];
}

template <class Value>
__global__ void join_stages(Rows rows, const Value* first, const Value* second, Value* stages) {
  let_next_begin();
  await_previous();
  if (!rows.has_thread()) return;
  const long at = rows.at(rows.row());
  if (rows.row() > 0) stages[rows.at(2 * long(rows.row()) - 1)] = first[at];
  stages[rows.at(2 * long(rows.row()))] = second[at];
}

// One thread per constraint and step of both stages.
__global__ void relax_stages(Rows steps, double first, double second_by_first, double second, const double* r,
                             const double* v, double* y) {
  let_next_begin();
  await_previous();
  if (!steps.has_thread() || steps.row() == 0) return;
  const long one = steps.at(2 * long(steps.row()) - 1), two = steps.at(2 * long(steps.row()));
  const double before = y[one], after = fmax(0.0, before - first * (r[one] + v[one]));
  y[one] = after;
  y[two] = fmax(0.0, y[two] - second * (r[two] + v[two] + second_by_first * (after - before)));
}

__global__ void pose_ends(Rows rows, const double* r, const double* v, const double* y, const double* coarse_v,
                          double* coarse_r, double* coarse_y, double* old) {
  let_next_begin();
  await_previous();
  if (!rows.has_thread()) return;
  const long i = rows.at(rows.row()), two = rows.at(2 * long(rows.row()));
  const double value = y[two];
  double q = r[two] + v[two];
  if (rows.row() > 0) {
    const long one = rows.at(2 * long(rows.row()) - 1);
    if ((y[one] > 0) == (value > 0)) q += 0.75 * (r[one] + v[one] - q);
  }
  coarse_r[i] = q - coarse_v[i];
  coarse_y[i] = old[i] = value;
}

// Row j <- Σ_i a_ji V_i; V has columns of `cols` values.
__global__ void write_product(const double* a, const double* V, int rows, int cols, int step, int terms, double* to) {
  let_next_begin();
  await_previous();
  for (long at = first_value(); at < long(rows) * cols; at += all_threads()) {
    const long row = at / cols, col = at % cols;
    double sum = a[row * terms] * V[col];
    for (int i = 1; i < terms; ++i) sum += a[row * terms + i] * V[long(i) * cols + col];
    to[row * step + col] = sum;
  }
}

constexpr int edge = 16, depth = 32;  ///< of the tiles of a product: rows of each factor, and columns at a time

// to <- P X^T, one thread per value, with tiles of both factors in shared memory.
__global__ void project(const double* P, int p_step, const double* X, int k, int n, int m, int step, double* to) {
  __shared__ double of_P[edge][depth + 1], of_X[edge][depth + 1];
  let_next_begin();
  const int first_row = int(blockIdx.y) * edge, first_col = int(blockIdx.x) * edge;
  const int x = int(threadIdx.x), y = int(threadIdx.y);
  double sum = 0;
  await_previous();
  for (int q0 = 0; q0 < m; q0 += depth) {
    for (int q = x; q < depth; q += edge) {
      const bool inside = q0 + q < m;
      of_P[y][q] = inside && first_row + y < k ? P[long(first_row + y) * p_step + q0 + q] : 0;
      of_X[y][q] = inside && first_col + y < n ? X[long(first_col + y) * m + q0 + q] : 0;
    }
    __syncthreads();
#pragma unroll 8
    for (int q = 0; q < depth; ++q) sum += of_P[y][q] * of_X[x][q];
    __syncthreads();
  }
  if (first_row + y < k && first_col + x < n) to[long(first_row + y) * step + first_col + x] = sum;
}

__global__ void add_multiple(const double* b, double s, const double* c, long values, double* a) {
  let_next_begin();
  await_previous();
  for (long i = first_value(); i < values; i += all_threads()) a[i] = b[i] + s * c[i];
}

// A warp or a block for each row; the maximum over the rows goes to `out`, NaN included.
__global__ void differences(const double* a, const double* b, int rows, int cols, int step, double* out) {
  __shared__ double of_warps[2][32];
  let_next_begin();
  await_previous();
  const int row = int(blockIdx.x) * int(blockDim.y) + int(threadIdx.y);
  if (row >= rows) return;  // uniform over the warp; a block of one row has none
  const double* const p = a + long(row) * step;
  const double* const q = b + long(row) * step;
  double gap = 0, size = 1;
#pragma unroll 4
  for (int i = int(threadIdx.x); i < cols; i += int(blockDim.x)) {
    gap = larger(fabs(p[i] - q[i]), gap);
    size = fmax(size, fabs(p[i]));
  }
  for (int lane = 16; lane > 0; lane /= 2) {
    gap = larger(__shfl_xor_sync(~0u, gap, lane), gap);
    size = fmax(size, __shfl_xor_sync(~0u, size, lane));
  }
  if (blockDim.x > 32) {
    if (threadIdx.x % 32 == 0) of_warps[0][threadIdx.x / 32] = gap, of_warps[1][threadIdx.x / 32] = size;
    __syncthreads();
    for (int w = 0; w < int(blockDim.x) / 32; ++w) {
      gap = larger(of_warps[0][w], gap);
      size = fmax(size, of_warps[1][w]);
    }
  }
  if (threadIdx.x == 0) atomicMax(reinterpret_cast<unsigned long long*>(out), bits(gap / size));
}

// From here on: one thread per column and chunk of rows.
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

// Finds runs that end in the chunk; reading starts `run` rows earlier.
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

/// Launches one thread per value of `array`: `of_two` if values can be paired, otherwise `of_one`.
template <class... Parameters, class... PairParameters, class... Arguments>
void follow_rows(const Device& device, const Array& array, const char* what, void (*of_one)(Rows, Parameters...),
                 void (*of_two)(Rows, PairParameters...), Arguments... arguments) {
  const Index all = stride(array.cols()), width = all % 2 == 0 ? all / 2 : all;
  unsigned across = 1;
  while (across < width && across < threads) across *= 2;
  const Blocks blocks{dim3(unsigned((array.rows() + threads / across - 1) / (threads / across)),
                           unsigned((width + across - 1) / across)),
                      dim3(across, threads / across)};
  const Rows rows{int(array.rows()), int(width)};
  if (width == all)
    follow(device, of_one, blocks, what, rows, Parameters(arguments)...);
  else
    follow(device, of_two, blocks, what, rows, (PairParameters)(arguments)...);
}

}  // namespace

void upload_product(const Device& device, const RowMatrix& amplitudes, const Matrix& shapes, Array& to) {
  const Memory<double> a = on_device(device, amplitudes), V = on_device(device, shapes);
  follow(device, write_product, {blocks(amplitudes.rows() * to.cols()), threads}, "starting a product of shapes",
         a.data(), V.data(), int(amplitudes.rows()), int(to.cols()), int(stride(to.cols())), int(shapes.cols()),
         values(to));
}

void upload_projection(const Device& device, const Vector& from, const Array& P, Array& to) {
  Memory<double> X(device, std::size_t(from.size()));
  device.fetcher().send(from.data(), std::size_t(from.size()), X.data(), device.stream());
  const Index k = to.rows(), n = to.cols();
  follow(device, project, {dim3(unsigned((n + edge - 1) / edge), unsigned((k + edge - 1) / edge)), dim3(edge, edge)},
         "starting a projection", values(P), int(stride(P.cols())), X.data(), int(k), int(n), int(P.cols()),
         int(stride(n)), values(to));
}

void inject(const Device& device, const Array& fine, Array& coarse) {
  follow_rows(device, coarse, "starting an injection", take_rows<double>, take_rows<double2>, values(fine),
              ratio(fine, coarse), values(coarse));
}

void interpolate(const Device& device, const Array& coarse, const Array* old, Array& fine) {
  follow_rows(device, coarse, "starting an interpolation", add_interpolation<double>, add_interpolation<double2>,
              values(coarse), old ? values(*old) : nullptr, ratio(fine, coarse), values(fine));
}

void restrict_problem(const Device& device, const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                      Array& coarse_r, Array& coarse_y, Array& old) {
  follow_rows(device, coarse_y, "posing a coarse problem", pose<double>, pose<double2>, values(r), values(v), values(y),
              values(coarse_v), ratio(y, coarse_y), values(coarse_r), values(coarse_y), values(old));
}

void take_stages(const Device& device, const Array& stages, Array& first, Array& second) {
  follow_rows(device, second, "splitting stages", split_stages<double>, split_stages<double2>, values(stages),
              values(first), values(second));
}

void put_stages(const Device& device, const Array& first, const Array& second, Array& stages) {
  follow_rows(device, second, "joining stages", join_stages<double>, join_stages<double2>, values(first),
              values(second), values(stages));
}

namespace {

// One thread per value of rows 0..J.
std::pair<Blocks, Rows> threads_of_steps(Index rows, Index cols) {
  const Index width = stride(cols);
  unsigned across = 1;
  while (across < width && across < threads) across *= 2;
  return {{dim3(unsigned((rows + threads / across - 1) / (threads / across)), unsigned((width + across - 1) / across)),
           dim3(across, threads / across)},
          {int(rows), int(width)}};
}

}  // namespace

void sweep_stages(const Device& device, const StageDivisors& d, const Array& r, const Array& v, Array& y) {
  const auto [blocks, rows] = threads_of_steps((y.rows() - 1) / 2 + 1, y.cols());
  follow(device, relax_stages, blocks, "starting a sweep over stages", rows, 1 / d.first, d.second_by_first,
         1 / d.second, values(r), values(v), values(y));
}

void restrict_stages(const Device& device, const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                     Array& coarse_r, Array& coarse_y, Array& old) {
  const auto [blocks, rows] = threads_of_steps(coarse_y.rows(), coarse_y.cols());
  follow(device, pose_ends, blocks, "posing a coarse problem", rows, values(r), values(v), values(y), values(coarse_v),
         values(coarse_r), values(coarse_y), values(old));
}

void add(const Device& device, const Array& b, double s, const Array& c, Array& a) {
  const Index size = values_of(a);
  follow(device, add_multiple, {blocks(size), threads}, "starting a sum of arrays", values(b), s, values(c), size,
         values(a));
}

namespace {

class QueuedDifferences final : public Differences {
 public:
  QueuedDifferences(const Device& device, std::size_t slots)
      : device_(device), found_(device, slots), values_(slots, 0) {
    found_.clear();
  }

  void submit(std::size_t slot, const Array& a, const Array& b) override {
    double* const out = found_.data() + slot;
    check(cudaMemsetAsync(out, 0, sizeof(double), device_.stream()), "starting a difference of arrays");
    const bool long_rows = a.cols() >= 4 * threads;  // a block for each; short ones have a warp
    follow(
        device_, differences,
        long_rows ? Blocks{unsigned(a.rows()), unsigned(threads)} : Blocks{unsigned((a.rows() + 7) / 8), dim3(32, 8)},
        "starting a difference of arrays", values(a), values(b), int(a.rows()), int(a.cols()), int(stride(a.cols())),
        out);
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

  std::size_t bytes() const override { return found_.bytes(); }

 private:
  const Device& device_;
  Memory<double> found_;
  std::vector<double> values_;
  bool fresh_ = false;
};

}  // namespace

std::unique_ptr<Differences> make_differences(const Device& device, std::size_t slots) {
  return std::make_unique<QueuedDifferences>(device, slots);
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
