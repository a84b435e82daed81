#pragma once
// The orthonormal sine transform of rows of n = N - 1 values, N = 128, 256 or 512, by a complex transform of half the
// length. With x_0 = x_N = 0, W = e^{-2 pi i/N}, H = N/2 and * the complex conjugate (Press et al., Numerical Recipes,
// "Fast sine and cosine transforms"):
//
//     y_j = sin(pi j/N) (x_j + x_{N-j}) + (x_j - x_{N-j})/2,   c_m = y_{2m} + i y_{2m+1},   C = Fourier transform of c
//     Y_k = E_k + W^k O_k,   Y_{H-k} = (E_k - W^k O_k)*,   E_k = (C_k + C*_{H-k})/2,   O_k = -i (C_k - C*_{H-k})/2
//     S_{2k} = -Im Y_k,   S_1 = Y_0/2,   S_{2k+1} = S_{2k-1} + Re Y_k.
//
// The running sum adds up to H terms, so that rounding is up to sqrt(H) times that of the transform.
//
// A row is in shared memory, its entries j with even j before those with odd j: place(j) for x and S, at(m) and
// at(m) + apart for the two parts of c_m and C_m. A few neighbouring threads of a warp have a row, `held` complex
// values each, so that the two passes of the transform exchange values once, and no barrier of the block is needed.

#include "kernels/transform_rows.cuh"

namespace bromwich::cuda {

/// Tables of HalfTransform.
struct HalfTables {
  const double2* roots;  ///< e^{-i pi m/N}, m < 2N
  const double* sines;   ///< sqrt(2/N) sin(pi j/N)/2, j < N
  double half;           ///< sqrt(2/N)/4
};

/// z_q <- Σ_r e^{-2 pi i q r/16} z_r; the result q is in place 4 (q % 4) + q / 4.
template <int held>
__device__ inline void butterfly_16(double2 (&z)[held], int first, int step) {
  constexpr double c = 0.92387953251128675613, s = 0.38268343236508977173, h = 0.70710678118654752440;
  double2* const a = z + first;
#pragma unroll
  for (int b = 0; b < 4; ++b) butterfly<4>(z, first + b * step, 4 * step);
  a[5 * step] = double2{c, -s} * a[5 * step];
  a[9 * step] = double2{h, -h} * a[9 * step];
  a[13 * step] = double2{s, -c} * a[13 * step];
  a[6 * step] = double2{h, -h} * a[6 * step];
  a[10 * step] = over_i(a[10 * step]);
  a[14 * step] = double2{-h, -h} * a[14 * step];
  a[7 * step] = double2{s, -c} * a[7 * step];
  a[11 * step] = double2{-h, -h} * a[11 * step];
  a[15 * step] = double2{-c, s} * a[15 * step];
#pragma unroll
  for (int q = 0; q < 4; ++q) butterfly<4>(z, first + 4 * q * step, step);
}

template <int N>
struct HalfTransform {
  static constexpr int H = N / 2, held = 16, threads = H / held;
  static_assert(threads > 1 && threads <= held);
  static constexpr int in_warp = 32 / threads;     ///< rows
  static constexpr int apart = H + H / 16;         ///< of even and odd entries
  static constexpr int pitch = 2 * apart + 4;      ///< of the rows of a warp
  static constexpr int gap = in_warp * pitch + 1;  ///< of the rows of different warps: no conflicts along a column
  double* row;
  int t;

  /// Of row `c` of a block.
  __device__ static double* of(double* shared, int c) { return shared + c / in_warp * gap + c % in_warp * pitch; }
  __host__ __device__ static constexpr int size(int rows) { return (rows + in_warp - 1) / in_warp * gap; }
  /// A gap after every sixteenth value: no conflicts of neighbours, nor of values sixteen apart.
  __device__ static int at(int m) { return m + m / 16; }
  __device__ static int place(int j) { return at(j / 2) + j % 2 * apart; }

  // Results of a butterfly of R values, and where they are.
  template <int R>
  __device__ static void mix(double2 (&z)[held], int first, int step) {
    if constexpr (R == 16)
      butterfly_16(z, first, step);
    else
      butterfly<R>(z, first, step);
  }
  template <int R>
  static constexpr int result(int r) {
    return R == 16 ? 4 * (r % 4) + r / 4 : r;
  }

  __device__ void put(int m, double2 value) const { row[at(m)] = value.x, row[at(m) + apart] = value.y; }
  __device__ double2 get(int m) const { return {row[at(m)], row[at(m) + apart]}; }

  __device__ void take_up(const HalfTables& tables, double2 (&z)[held]) const {
#pragma unroll
    for (int q = 0; q < held; ++q) {
      const int m = t + q * threads;
      const double2 s = __ldg(reinterpret_cast<const double2*>(tables.sines) + m);
      const double even = row[at(m)], odd = row[at(m) + apart], last = row[at(H - 1 - m) + apart];
      const double before_last = row[at(m > 0 ? H - m : 0)];
      z[q].x = m > 0 ? s.x * (even + before_last) + tables.half * (even - before_last) : 0;
      z[q].y = s.y * (odd + last) + tables.half * (odd - last);
    }
    __syncwarp();
  }

  // C, in two passes with `held` and `threads` as their radices.
  __device__ void transform(const HalfTables& tables, double2 (&z)[held]) const {
    mix<held>(z, 0, 1);
#pragma unroll
    for (int r = 0; r < held; ++r) put(t * held + r, z[result<held>(r)]);
    __syncwarp();
    constexpr int together = held / threads;
#pragma unroll
    for (int b = 0; b < together; ++b) {
      const int j = t + b * threads;
      const double2 w = __ldg(tables.roots + 4 * j);
      double2 power = w;
      z[b] = get(j);
#pragma unroll
      for (int r = 1; r < threads; ++r) {
        z[b + r * together] = power * get(j + r * held);
        if (r + 1 < threads) power = power * w;
      }
      mix<threads>(z, b, together);
#pragma unroll
      for (int r = 0; r < threads; ++r) put(j + r * held, z[b + result<threads>(r) * together]);
    }
    __syncwarp();
  }

  // S with even indices, and Re Y_k in the places of S_{2k+1}.
  __device__ void separate(const HalfTables& tables) const {
    constexpr int pairs = held / 2;
    double2 low[pairs], high[pairs];  // S and Re Y
#pragma unroll
    for (int q = 0; q < pairs; ++q) {
      const int k = 1 + t + q * threads;
      const double2 C = get(k), D = get(H - k), w = __ldg(tables.roots + 2 * k);
      const double2 E{C.x + D.x, C.y - D.y}, P = w * double2{C.y + D.y, D.x - C.x};
      low[q] = {-(E.y + P.y), E.x + P.x};
      high[q] = {E.y - P.y, E.x - P.x};
    }
    const double2 first = get(0);
    __syncwarp();
#pragma unroll
    for (int q = 0; q < pairs; ++q) {
      const int k = 1 + t + q * threads;
      put(k, low[q]);
      if (2 * k < H) put(H - k, high[q]);
    }
    if (t == 0) row[apart] = first.x + first.y;
    __syncwarp();
  }

  __device__ void add_up() const {
    double sums[held];
#pragma unroll
    for (int r = 0; r < held; ++r) sums[r] = (r > 0 ? sums[r > 0 ? r - 1 : 0] : 0) + row[at(t * held + r) + apart];
    double all = sums[held - 1];
#pragma unroll
    for (int far = 1; far < threads; far *= 2) {
      const double other = __shfl_up_sync(~0u, all, far * in_warp);
      if (t >= far) all += other;
    }
    const double others = __shfl_up_sync(~0u, all, in_warp), before = t > 0 ? others : 0;
#pragma unroll
    for (int r = 0; r < held; ++r) row[at(t * held + r) + apart] = before + sums[r];
    __syncwarp();
  }

  /// The row, by all threads of a warp. Other warps may read it after a barrier.
  __device__ void operator()(const HalfTables& tables) const {
    double2 z[held];
    take_up(tables, z);
    transform(tables, z);
    separate(tables);
    add_up();
  }
};

}  // namespace bromwich::cuda
