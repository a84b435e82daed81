// The orthonormal sine transform of rows of n = N - 1 values, N a power of two, in one kernel: N/8 threads a row, eight
// complex values each in registers, which the passes of a Stockham FFT exchange in shared memory.
//
// The odd extension x_{2N-m} = -x_m of a row, 2N real values, becomes N complex ones, z_j = x_{2j} + i x_{2j+1}. With
// Z the Fourier transform of z and X that of x,
//
//     2 X_k = (Z_k + Z*_{N-k}) - i e^{-i pi k/N} (Z_k - Z*_{N-k}),   Σ_m x_m sin(pi m k/N) = -Im X_k / 2   (m < N),
//
// where * is the complex conjugate.

#include "kernels/launch.cuh"
#include "kernels/parts.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace bromwich::cuda {

namespace {

constexpr int held = 8;              ///< complex values of a thread
constexpr int wanted_threads = 128;  ///< of a block, where rows are short
constexpr Index least_length = 16, largest_length = 4096;

__device__ double2 operator+(double2 a, double2 b) { return {a.x + b.x, a.y + b.y}; }
__device__ double2 operator-(double2 a, double2 b) { return {a.x - b.x, a.y - b.y}; }
__device__ double2 operator*(double2 a, double2 b) { return {a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x}; }
__device__ double2 over_i(double2 a) { return {a.y, -a.x}; }

/// z_q <- Σ_r e^{-2 pi i q r/R} z_r, r in steps of `step`.
template <int R>
__device__ void butterfly(double2 (&z)[held], int first, int step) {
  double2* const a = z + first;
  if constexpr (R == 2) {
    const double2 b = a[step];
    a[step] = a[0] - b;
    a[0] = a[0] + b;
  } else if constexpr (R == 4) {
    const double2 even = a[0] + a[2 * step], even_less = a[0] - a[2 * step];
    const double2 odd = a[step] + a[3 * step], odd_less = over_i(a[step] - a[3 * step]);
    a[0] = even + odd, a[2 * step] = even - odd;
    a[step] = even_less + odd_less, a[3 * step] = even_less - odd_less;
  } else {
    butterfly<4>(z, first, 2 * step);
    butterfly<4>(z, first + step, 2 * step);
    constexpr double h = 0.70710678118654752440;
    const double2 e0 = a[0], e1 = a[2 * step], e2 = a[4 * step], e3 = a[6 * step];
    const double2 o0 = a[step], o2 = over_i(a[5 * step]);
    const double2 o1 = double2{h, -h} * a[3 * step], o3 = double2{-h, -h} * a[7 * step];
    a[0] = e0 + o0, a[step] = e1 + o1, a[2 * step] = e2 + o2, a[3 * step] = e3 + o3;
    a[4 * step] = e0 - o0, a[5 * step] = e1 - o1, a[6 * step] = e2 - o2, a[7 * step] = e3 - o3;
  }
}

/// One row of N complex values in shared memory. Every eighth is followed by a gap, so that eight neighbouring threads
/// meet in no bank, be their values neighbours or eight apart.
template <int N>
struct TransformRow {
  static constexpr int threads = N / held, size = N + N / 8;
  double2* values;
  const double2* roots;  ///< e^{-i pi m/N}, m < 2N
  int t;

  __device__ double2& at(int i) const { return values[i + i / 8]; }

  // z_j from the row as it is given; a row that does not exist is zero.
  __device__ void take_up(const double* in, double2 (&z)[held]) const {
#pragma unroll
    for (int q = 0; q < held / 2; ++q) {
      const int j = t + q * threads, k = j + N / 2;
      z[q] = {in && j > 0 ? in[2 * j - 1] : 0, in ? in[2 * j] : 0};
      z[q + held / 2] = {in && j > 0 ? -in[2 * (N - k) - 1] : 0, in ? -in[2 * (N - k) - 2] : 0};
    }
  }

  // Of the pass behind those with a product `done` of radices, for its butterfly b.
  template <int done>
  static constexpr int radix = N / done >= held ? held : N / done;
  template <int done>
  __device__ double2 twiddle(int b) const {
    return __ldg(roots + (t + b * threads) % done * (2 * N / (done * radix<done>)));
  }

  // The first twiddle factor of each pass but the first.
  template <int done>
  __device__ void take_up(double2* w) const {
    if constexpr (done > 1) *w++ = twiddle<done>(0);
    if constexpr (done * radix<done> < N) take_up<done * radix<done>>(w);
  }

  // The passes behind those with a product `done` of radices; the last one's values have yet to meet.
  template <int done>
  __device__ void transform(double2 (&z)[held], const double2* first_twiddle) const {
    constexpr int R = radix<done>, together = held / R;
    if constexpr (done > 1) {
#pragma unroll
      for (int b = 0; b < together; ++b) {
        const double2 w = b == 0 ? *first_twiddle : twiddle<done>(b);
        double2 power = w;
#pragma unroll
        for (int r = 1; r < R; ++r) {
          z[b + r * together] = power * z[b + r * together];
          power = power * w;
        }
      }
      __syncthreads();
    }
#pragma unroll
    for (int b = 0; b < together; ++b) {
      butterfly<R>(z, b, together);
      const int j = t + b * threads, first = j / done * done * R + j % done;
#pragma unroll
      for (int r = 0; r < R; ++r) at(first + r * done) = z[b + r * together];
    }
    if constexpr (done * R < N) {
      __syncthreads();
#pragma unroll
      for (int q = 0; q < held; ++q) z[q] = at(t + q * threads);
      transform<done * R>(z, first_twiddle + (done > 1 ? 1 : 0));
    }
  }

  __device__ void give_back(bool there, const double* add, double* out, double scale) const {
    double2 of_part[held / 2];
#pragma unroll
    for (int q = 0; q < held / 2; ++q) of_part[q] = __ldg(roots + 1 + t + q * threads);
    __syncthreads();
    if (!there) return;
#pragma unroll
    for (int q = 0; q < held / 2; ++q) {
      const int k = 1 + t + q * threads;
      const double2 Z = at(k), opposite = at(N - k), root = of_part[q];
      const double odd = scale * (Z.y - opposite.y);
      const double even = scale * (root.y * (Z.y + opposite.y) - root.x * (Z.x - opposite.x));
      out[k - 1] = (add ? add[k - 1] : 0) + (even + odd);
      if (2 * k < N) out[N - k - 1] = (add ? add[N - k - 1] : 0) + (even - odd);
    }
  }
};

template <int N>
__global__ void __launch_bounds__(N / held > wanted_threads ? N / held : wanted_threads)
    transform_rows(const double* in, const double* add, double* out, int rows, int stride,
                   const double2* __restrict__ roots, double scale) {
  extern __shared__ double2 memory[];
  const int row = int(blockIdx.x) * int(blockDim.y) + int(threadIdx.y);
  const long at = long(row) * stride;
  const TransformRow<N> part{memory + int(threadIdx.y) * TransformRow<N>::size, roots, int(threadIdx.x)};
  double2 z[held], twiddles[4];
  let_next_begin();
  part.template take_up<1>(twiddles);
  await_previous();
  part.take_up(row < rows ? in + at : nullptr, z);
  part.template transform<1>(z, twiddles);
  part.give_back(row < rows, add ? add + at : nullptr, out + at, scale);
}

/// e^{-i pi m/N}, m < 2N.
struct Roots {
  Roots(const Device& device, Index N) : N(N), values(device, std::size_t(2 * N)) {
    std::vector<double2> all(std::size_t(2 * N));
    for (Index m = 0; m < 2 * N; ++m) {
      const double angle = std::numbers::pi * double(m) / double(N);
      all[std::size_t(m)] = {std::cos(angle), -std::sin(angle)};
    }
    values.put(all.data());
  }

  Index N;
  Memory<double2> values;
};

class SineRows final : public SineTransform {
 public:
  SineRows(const Device& device, Index n)
      : device_(device),
        N_(n + 1),
        roots_(device.shared<Roots>([n](const Roots& kept) { return kept.N == n + 1; },
                                    [&] { return std::make_shared<Roots>(device, n + 1); })) {
    choose<least_length>();
    check(
        cudaFuncSetAttribute(kernel_, cudaFuncAttributeMaxDynamicSharedMemorySize, int(shared_bytes(most_together()))),
        "reserving shared memory");
  }

  void apply(const Array& in, const Array* add, Array& out, Index first) override {
    const Index rows = in.rows() - first, step = stride(N_ - 1);
    if (rows <= 0) return;
    // All multiprocessors get rows before any block gets many.
    const Index even = (rows + device_.multiprocessors() - 1) / device_.multiprocessors();
    const Index together = std::clamp<Index>(even, std::max<Index>(32 / threads(), 1), most_together());
    follow(device_, kernel_,
           {unsigned((rows + together - 1) / together), dim3(unsigned(threads()), unsigned(together)),
            shared_bytes(together)},
           "the sine transform", values(in) + first * step, add ? values(*add) + first * step : nullptr,
           values(out) + first * step, int(rows), int(step), roots_->values.data(),
           -0.25 * std::sqrt(2.0 / double(N_)));
  }

  std::size_t bytes() const override { return roots_->values.bytes(); }

 private:
  Index threads() const { return N_ / held; }
  Index most_together() const { return std::max<Index>(wanted_threads / threads(), 1); }
  std::size_t shared_bytes(Index rows) const { return sizeof(double2) * std::size_t(rows * (N_ + N_ / 8)); }

  template <int N>
  void choose() {
    if (N_ == N)
      kernel_ = transform_rows<N>;
    else if constexpr (N < largest_length)
      choose<2 * N>();
  }

  const Device& device_;
  Index N_;
  std::shared_ptr<Roots> roots_;
  void (*kernel_)(const double*, const double*, double*, int, int, const double2*, double) = nullptr;
};

}  // namespace

bool has_sine_rows(Index n) {
  const Index N = n + 1;
  return N >= least_length && N <= largest_length && (N & n) == 0;
}

std::unique_ptr<SineTransform> make_sine_rows(const Device& device, Index n) {
  return std::make_unique<SineRows>(device, n);
}

}  // namespace bromwich::cuda
