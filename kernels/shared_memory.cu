// Copies between arrays of the backend and memory that other programs know (core/seam/shared_memory.hpp), and
// q <- q + M y.

#include "kernels/launch.cuh"
#include "kernels/parts.hpp"

#include <algorithm>

namespace bromwich::cuda {

namespace {

constexpr int threads = 256;
constexpr Index most_blocks = 1 << 16;

Blocks one_each(Index values) { return {unsigned(std::min((values + threads - 1) / threads, most_blocks)), threads}; }

__device__ long first_value() { return blockIdx.x * long(blockDim.x) + threadIdx.x; }
__device__ long all_threads() { return gridDim.x * long(blockDim.x); }

__global__ void add_three_diagonals(const double* lower, const double* diagonal, const double* upper, const double* y,
                                    int rows, int n, int step, double* q) {
  let_next_begin();
  await_previous();
  for (long at = first_value(); at < long(rows) * n; at += all_threads()) {
    const long row = at / n, i = at % n;
    const double* const value = y + row * step + i;
    double sum = diagonal[i] * value[0];
    if (i > 0) sum += lower[i] * value[-1];
    if (i + 1 < n) sum += upper[i] * value[1];
    q[row * step + i] += sum;
  }
}

// M: n x n, column by column.
__global__ void add_dense_product(const double* M, const double* y, int rows, int n, int step, double* q) {
  let_next_begin();
  await_previous();
  for (long at = first_value(); at < long(rows) * n; at += all_threads()) {
    const long row = at / n, i = at % n;
    double sum = 0;
    for (int k = 0; k < n; ++k) sum += M[long(k) * n + i] * y[row * step + k];
    q[row * step + i] += sum;
  }
}

// M by rows: row i has the entries from begin[i] to begin[i + 1].
__global__ void add_sparse_product(const int* begin, const int* column, const double* entry, const double* y, int rows,
                                   int n, int step, double* q) {
  let_next_begin();
  await_previous();
  for (long at = first_value(); at < long(rows) * n; at += all_threads()) {
    const long row = at / n, i = at % n;
    double sum = 0;
    for (int k = begin[i]; k < begin[i + 1]; ++k) sum += entry[k] * y[row * step + column[k]];
    q[row * step + i] += sum;
  }
}

void copy_rows(const Device& device, const double* from, Index from_step, double* to, Index to_step, Index rows,
               Index cols) {
  if (rows == 0 || cols == 0) return;
  const auto bytes = [](Index values) { return sizeof(double) * std::size_t(values); };
  device.note_work();
  check(cudaMemcpy2DAsync(to, bytes(to_step), from, bytes(from_step), bytes(cols), std::size_t(rows),
                          cudaMemcpyDeviceToDevice, device.stream()),
        "copying between arrays of the device");
}

}  // namespace

std::shared_ptr<double> numbers(Index values) {
  void* memory = nullptr;
  check(cudaMalloc(&memory, sizeof(double) * std::size_t(std::max<Index>(values, 1))), "allocating a shared array");
  // cudaFree waits for the device, also for work of others on this memory.
  return {static_cast<double*>(memory), [](double* p) { cudaFree(p); }};
}

void read(const Device& device, const double* from, Array& to) {
  copy_rows(device, from, to.cols(), values(to), stride(to.cols()), to.rows(), to.cols());
}

void write(const Device& device, const Array& from, double* to) {
  copy_rows(device, values(from), stride(from.cols()), to, from.cols(), from.rows(), from.cols());
}

void to_host(const Device& device, const void* from, std::size_t bytes, void* to) {
  check(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDeviceToHost, device.stream()), "copying from the device");
  device.wait();
}

void add_product(const Device& device, const LcpMatrix& M, const Array& y, Array& q) {
  const int rows = int(y.rows()), n = int(y.cols()), step = int(stride(y.cols()));
  const Blocks blocks = one_each(y.rows() * y.cols());
  if (const auto* three = std::get_if<Tridiagonal>(&M)) {
    const Memory<double> lower = on_device(device, three->lower), diagonal = on_device(device, three->diagonal),
                         upper = on_device(device, three->upper);
    follow(device, add_three_diagonals, blocks, "starting M y", lower.data(), diagonal.data(), upper.data(), values(y),
           rows, n, step, values(q));
    device.wait();
    return;
  }
  if (const SparseMatrix* given = sparse_of(M)) {
    const Eigen::SparseMatrix<double, Eigen::RowMajor, int> by_rows = *given;
    Memory<int> begin(device, std::size_t(n) + 1), column(device, std::size_t(by_rows.nonZeros()));
    Memory<double> entry(device, std::size_t(by_rows.nonZeros()));
    begin.put(by_rows.outerIndexPtr());
    column.put(by_rows.innerIndexPtr());
    entry.put(by_rows.valuePtr());
    follow(device, add_sparse_product, blocks, "starting M y", begin.data(), column.data(), entry.data(), values(y),
           rows, n, step, values(q));
    device.wait();
    return;
  }
  const Memory<double> dense = on_device(device, to_dense(M));
  follow(device, add_dense_product, blocks, "starting M y", dense.data(), values(y), rows, n, step, values(q));
  device.wait();
}

}  // namespace bromwich::cuda
