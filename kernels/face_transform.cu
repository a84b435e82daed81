// The orthonormal sine transform of rows that are indexed by two directions, a Q2 x Q3 grid at each time, one direction
// after the other. Where both have 2^k - 1 points: kernels of the row transform (transform_rows.cuh), for the slow
// direction with eight or more columns of a grid in shared memory, so that rows are read and written in whole sectors.
// Otherwise products with the sine matrices, batched over times: no transposes, since a grid of either layout is a
// matrix to cuBLAS.

#include "kernels/blas.hpp"
#include "kernels/face_halves.hpp"
#include "kernels/face_product.hpp"
#include "kernels/face_transform.hpp"
#include "kernels/launch.cuh"
#include "kernels/parts.hpp"
#include "kernels/transform_rows.cuh"

#include "core/numerics/sine_basis.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

namespace bromwich::cuda {

namespace {

constexpr int held = 8;            ///< complex values per thread
constexpr int rows_threads = 128;  ///< per block, along rows
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

// Along the fast direction: N - 1 = points, one row of threads for each line.
template <int N>
__global__ void __launch_bounds__(N / held > rows_threads ? N / held : rows_threads)
    along_lines(const double* in, double* out, FaceShape s, const double2* __restrict__ roots, double scale) {
  extern __shared__ double2 memory[];
  const long line = long(blockIdx.x) * int(blockDim.y) + int(threadIdx.y);
  const bool there = line < long(s.lines) * s.times;
  const long at = line / s.lines * s.stride + line % s.lines * s.points;
  using Row = TransformRow<N, held>;
  const Row part{memory + int(threadIdx.y) * Row::size, roots, int(threadIdx.x)};
  double2 twiddles[Row::passes - 1];
  let_next_begin();
  part.template take_up<1>(twiddles);
  await_previous();
  part(
      twiddles, scale, [=](int i) { return there ? in[at + i] : 0; },
      [=](int i, double x) {
        if (there) out[at + i] = x;
      });
}

/// Columns that a block takes together.
template <int N>
inline constexpr int columns = N >= 128 ? 8 : 16;

template <int N>
inline constexpr std::size_t column_bytes = sizeof(double2) * std::size_t(columns<N>) * (N + N / 8) +
                                            sizeof(double) * std::size_t(N - 1) * (columns<N> + 1);

// Along the slow direction: N - 1 = lines. Block (columns of a grid, time). `in` may be `out`.
template <int N>
__global__ void __launch_bounds__(N / held * columns<N>)
    along_columns(const double* in, const double* add, const double* factor, double* out, FaceShape s,
                  const double2* __restrict__ roots, double scale) {
  extern __shared__ double2 memory[];
  using Row = TransformRow<N, held>;
  constexpr int W = columns<N>, n = N - 1;
  double* const tile = reinterpret_cast<double*>(memory + W * Row::size);
  const int groups = (s.points + W - 1) / W, group = int(blockIdx.x) % groups, time = int(blockIdx.x) / groups;
  const int me = int(threadIdx.y) * int(blockDim.x) + int(threadIdx.x), all = int(blockDim.x * blockDim.y);
  const int width = min(W, s.points - group * W), column = int(threadIdx.y);
  const long at = long(time) * s.stride + group * W;
  const Row part{memory + column * Row::size, roots, int(threadIdx.x)};
  double2 twiddles[Row::passes - 1];
  let_next_begin();
  part.template take_up<1>(twiddles);
  await_previous();
  for (int a = me; a < n * W; a += all) {
    const int i = a / W, c = a % W;
    tile[i * (W + 1) + c] = c < width ? in[at + long(i) * s.points + c] : 0;
  }
  __syncthreads();
  part(
      twiddles, scale, [=](int i) { return tile[i * (W + 1) + column]; },
      [=](int i, double x) { tile[i * (W + 1) + column] = x; });
  __syncthreads();
  for (int a = me; a < n * W; a += all) {
    const int i = a / W, c = a % W;
    const long to = at + long(i) * s.points + c;
    const double scaled = factor && c < width ? factor[group * W + long(i) * s.points + c] : 1;
    if (c < width) out[to] = (add ? add[to] : 0) + scaled * tile[i * (W + 1) + c];
  }
}

constexpr Index least_length = 16, largest_length = 512;

bool is_fast(Index n) {
  const Index N = n + 1;
  return N >= least_length && N <= largest_length && (N & n) == 0;
}

double scale_of(Index N) { return -0.25 * std::sqrt(2.0 / double(N)); }

}  // namespace

struct FaceKernels::Tables {
  std::optional<FaceHalves> halves;
  Memory<double2> of_lines, of_points;
  void (*rows)(const double*, double*, FaceShape, const double2*, double) = nullptr;
  void (*columns)(const double*, const double*, const double*, double*, FaceShape, const double2*, double) = nullptr;
  Index width = 1;
  std::size_t column_bytes = 0;

  template <int N>
  void choose(Index lines, Index points) {
    if (points + 1 == N) {
      rows = along_lines<N>;
      const Index together = std::max<Index>(rows_threads / (N / held), 1);
      reserve((const void*)rows, sizeof(double2) * std::size_t(together * (N + N / 8)));
    }
    if (lines + 1 == N) {
      columns = along_columns<N>;
      width = cuda::columns<N>;
      column_bytes = cuda::column_bytes<N>;
      reserve((const void*)columns, column_bytes);
    }
    if constexpr (N < largest_length) choose<2 * N>(lines, points);
  }
  static void reserve(const void* kernel, std::size_t bytes) {
    check(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, int(bytes)),
          "reserving shared memory");
  }
};

FaceKernels::FaceKernels(const Device& device, const std::vector<Index>& extents)
    : device_(device), lines_(extents[0]), points_(extents[1]), tables_(std::make_unique<Tables>()) {
  tables_->of_lines = roots_of(device, lines_ + 1);
  tables_->of_points = roots_of(device, points_ + 1);
  tables_->choose<int(least_length)>(lines_, points_);
  if (FaceHalves::take(extents)) tables_->halves.emplace(device, extents);
}

FaceKernels::~FaceKernels() = default;

bool FaceKernels::take(const std::vector<Index>& extents) {
  return extents.size() == 2 && is_fast(extents[0]) && is_fast(extents[1]);
}

void FaceKernels::apply(const double* in, const double* add, const double* factor, double* between, double* out,
                        Index rows) const {
  if (tables_->halves && tables_->halves->suits(rows))
    return tables_->halves->apply(in, add, factor, between, out, rows);
  const FaceShape s{int(lines_), int(points_), int(rows), int(stride(lines_ * points_))};
  const Index N = points_ + 1, threads = N / held, together = std::max<Index>(rows_threads / threads, 1);
  follow(device_, tables_->rows,
         {unsigned((rows * lines_ + together - 1) / together), dim3(unsigned(threads), unsigned(together)),
          sizeof(double2) * std::size_t(together * (N + N / 8))},
         what, in, between, s, tables_->of_points.data(), scale_of(N));
  const Index width = tables_->width;
  follow(device_, tables_->columns,
         {unsigned(rows * ((points_ + width - 1) / width)), dim3(unsigned((lines_ + 1) / held), unsigned(width)),
          tables_->column_bytes},
         what, between, add, factor, out, s, tables_->of_lines.data(), scale_of(lines_ + 1));
}

std::size_t FaceKernels::bytes() const {
  return tables_->of_lines.bytes() + tables_->of_points.bytes() + (tables_->halves ? tables_->halves->bytes() : 0);
}

namespace {

/// A block has a whole face: up to 132 faces take 30 us on an H100. By lines and columns one takes 31 us, 64 take 226.
constexpr Index fewest_products = 4;

class FastFace final : public RowTransform {
 public:
  FastFace(const Device& device, const std::vector<Index>& extents) : device_(device), kernels_(device, extents) {
    if (FaceProducts::take(device, extents)) products_.emplace(device);
  }

  void apply(const Array& in, const Array* add, Array& out, Index first) override {
    const Index rows = in.rows() - first, step = stride(in.cols());
    if (rows <= 0) return;
    if (products_ && !add && rows >= fewest_products)
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

// Products with P and Q of the two directions, X <- P X Q^T. Row-major grids are their transposes to cuBLAS:
// (X Q^T)^T = Q X^T, then (P X)^T = X^T P^T.
class FaceProduct final : public RowTransform {
 public:
  FaceProduct(const Device& device, const Matrix& P, const Matrix& Q)
      : device_(device),
        lines_(P.rows()),
        points_(Q.rows()),
        blas_(shared_blas(device)),
        of_lines_(on_device(device, Matrix(P.transpose()))),
        of_points_(on_device(device, Q)) {}

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

// Two neighbouring directions with the fewest points together become one: P (x) Q.
void join_shortest(std::vector<Matrix>& products) {
  std::size_t at = 0;
  for (std::size_t i = 1; i + 1 < products.size(); ++i)
    if (products[i].rows() * products[i + 1].rows() < products[at].rows() * products[at + 1].rows()) at = i;
  const Matrix P = products[at], Q = products[at + 1];
  Matrix joined(P.rows() * Q.rows(), P.cols() * Q.cols());
  for (Index i = 0; i < P.rows(); ++i)
    for (Index j = 0; j < P.cols(); ++j) joined.block(i * Q.rows(), j * Q.cols(), Q.rows(), Q.cols()) = P(i, j) * Q;
  products[at] = joined;
  products.erase(products.begin() + std::ptrdiff_t(at) + 1);
}

}  // namespace

std::unique_ptr<RowTransform> make_face_transform(const Device& device, const FaceBasis& basis, Way way) {
  if (basis.empty()) return nullptr;
  const std::vector<Index> extents = basis.extents();
  if (basis.is_sine() && FaceKernels::take(extents)) return std::make_unique<FastFace>(device, extents);
  const auto matrix = [&](std::size_t direction) {
    const Matrix V = basis.directions()[direction].matrix();
    return way == Way::to_modes ? Matrix(V.transpose()) : V;
  };
  std::vector<Matrix> products;
  for (std::size_t i = 0; i < basis.size(); ++i) products.push_back(matrix(i));
  while (products.size() > 2) join_shortest(products);
  if (products.size() == 1) return make_row_product(device, products[0]);
  return std::make_unique<FaceProduct>(device, products[0], products[1]);
}

}  // namespace bromwich::cuda
