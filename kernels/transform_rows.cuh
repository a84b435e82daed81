#pragma once
// The orthonormal sine transform of a row of n = N - 1 values, N a power of two, by a group of threads. Each thread
// holds a few complex values in registers, exchanged in shared memory between the passes of a Stockham FFT.
//
// The odd extension x_{2N-m} = -x_m of a row, 2N real values, becomes N complex ones, z_j = x_{2j} + i x_{2j+1}. With
// Z the Fourier transform of z and X that of x,
//
//     2 X_k = (Z_k + Z*_{N-k}) - i e^{-i pi k/N} (Z_k - Z*_{N-k}),   Σ_m x_m sin(pi m k/N) = -Im X_k / 2   (m < N),
//
// where * is the complex conjugate.

#include "core/seam/backend.hpp"

#include <cuda_runtime.h>

#include <bit>

namespace bromwich::cuda {

/// Tables of a row transform: e^{-i pi m/N}, m < 2N, and the scale of its sums.
struct SineTables {
  const double2* roots;
  double scale;
};

/// Tables of a transform for which `has_sine_rows`; they live as long as the transform.
SineTables sine_tables(const RowTransform&);

__device__ inline double2 operator+(double2 a, double2 b) { return {a.x + b.x, a.y + b.y}; }
__device__ inline double2 operator-(double2 a, double2 b) { return {a.x - b.x, a.y - b.y}; }
__device__ inline double2 operator*(double2 a, double2 b) { return {a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x}; }
__device__ inline double2 over_i(double2 a) { return {a.y, -a.x}; }

/// Butterfly z_q <- Σ_r e^{-2 pi i q r/R} z_r, r in steps of `step`.
template <int R, int held>
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

/// One row of N complex values in shared memory. A gap follows every eighth value, so that eight neighbouring threads
/// have no bank conflicts, whether their values are neighbours or eight apart. Each thread holds `held` values; all
/// threads of the block must take part.
template <int N, int held, bool one_warp = false>
struct TransformRow {
  static constexpr int threads = N / held, size = N + N / 8;
  static constexpr int passes =
      (std::bit_width(unsigned(N)) - 1 + std::bit_width(unsigned(held)) - 2) / (std::bit_width(unsigned(held)) - 1);
  double2* values;
  const double2* roots;  ///< e^{-i pi m/N}, m < 2N
  int t;

  __device__ double2& at(int i) const { return values[i + i / 8]; }

  __device__ void meet() const {
    if constexpr (one_warp)
      __syncwarp();
    else
      __syncthreads();
  }

  // z_j from the row x: in(i) is x_{i+1}.
  template <class Row>
  __device__ void take_up(const Row& in, double2 (&z)[held]) const {
#pragma unroll
    for (int q = 0; q < held / 2; ++q) {
      const int j = t + q * threads, k = j + N / 2;
      z[q] = {j > 0 ? in(2 * j - 1) : 0, in(2 * j)};
      z[q + held / 2] = {j > 0 ? -in(2 * (N - k) - 1) : 0, -in(2 * (N - k) - 2)};
    }
  }

  // Radix of the pass after passes with a product `done` of radices.
  template <int done>
  static constexpr int radix = N / done >= held ? held : N / done;
  template <int done>
  __device__ double2 twiddle(int b) const {
    return __ldg(roots + (t + b * threads) % done * (2 * N / (done * radix<done>)));
  }

  // Loads the first twiddle factor of each pass except the first.
  template <int done>
  __device__ void take_up(double2* w) const {
    if constexpr (done > 1) *w++ = twiddle<done>(0);
    if constexpr (done * radix<done> < N) take_up<done * radix<done>>(w);
  }

  // The passes after those with a product `done` of radices. The last pass writes to shared memory without a barrier.
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
      meet();
    }
#pragma unroll
    for (int b = 0; b < together; ++b) {
      butterfly<R>(z, b, together);
      const int j = t + b * threads, first = j / done * done * R + j % done;
#pragma unroll
      for (int r = 0; r < R; ++r) at(first + r * done) = z[b + r * together];
    }
    if constexpr (done * R < N) {
      meet();
#pragma unroll
      for (int q = 0; q < held; ++q) z[q] = at(t + q * threads);
      transform<done * R>(z, first_twiddle + (done > 1 ? 1 : 0));
    }
  }

  // Calls give(i, x) for each value x_{i+1} of the transform, by one of the threads.
  template <class Give>
  __device__ void give_back(double scale, const Give& give) const {
    double2 of_part[held / 2];
#pragma unroll
    for (int q = 0; q < held / 2; ++q) of_part[q] = __ldg(roots + 1 + t + q * threads);
    meet();
#pragma unroll
    for (int q = 0; q < held / 2; ++q) {
      const int k = 1 + t + q * threads;
      const double2 Z = at(k), opposite = at(N - k), root = of_part[q];
      const double odd = scale * (Z.y - opposite.y);
      const double even = scale * (root.y * (Z.y + opposite.y) - root.x * (Z.x - opposite.x));
      give(k - 1, even + odd);
      if (2 * k < N) give(N - k - 1, even - odd);
    }
  }

  // The whole transform, with the factors loaded by `take_up<1>`.
  template <class Row, class Give>
  __device__ void operator()(const double2* first_twiddle, double scale, const Row& in, const Give& give) const {
    double2 z[held];
    take_up(in, z);
    transform<1>(z, first_twiddle);
    give_back(scale, give);
  }
};

}  // namespace bromwich::cuda
