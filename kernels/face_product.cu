// The orthonormal sine transform of faces of 127 x 127 points, both directions in one kernel, as products by tensor
// cores in double precision. One block takes a face at a time: it is read once and written once.
//
// With N = 128 and s = sqrt(2/N) the halves of a row separate (j = 1 .. N/2):
//
//     u_j = x_j + x_{N-j},  u_{N/2} = x_{N/2},   y_{2m+1} = Σ_j s sin(pi j (2m+1)/N) u_j   (m = 0 .. N/2 - 1)
//     v_j = x_j - x_{N-j},                       y_{2m+2} = Σ_j s sin(pi j (2m+2)/N) v_j   (m = 0 .. N/2 - 2)
//
// two products of N/2 x N/2, whose tables stay in registers: a warp has 16 columns of each. Lines are transformed in
// shared memory while later ones are still being read, then columns, whose values go from registers to memory.
//
// symbol   variable   shape      meaning
// face     face       128 x 132  lines in shared memory; entry 127 of a line and line 127 are zero
// tables   tables     2 x 64 x 64  the products of odd and of even outputs, row j - 1, column m; 2 u_{N/2} is read

#include "kernels/face_product.hpp"

#include "kernels/launch.cuh"

#include <cuda_pipeline_primitives.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace bromwich::cuda {

namespace {

constexpr int N = 128, n = N - 1, half = N / 2, pitch = N + 4;  ///< no bank conflicts along lines and columns
constexpr int warps = 8, teams = 2, of_team = warps / teams;    ///< a team takes a tile of 16 lines or columns
constexpr int tile = 16, pieces = N / (tile * teams);
constexpr int steps = half / 8;  ///< products of 16 x 8 and 8 x 8
constexpr std::size_t face_bytes = sizeof(double) * std::size_t(N) * pitch;

/// c += a b, 16 x 8 by 8 x 8. Lane 4 g + t has a(g, t), a(g + 8, t), a(g, t + 4), a(g + 8, t + 4), b(t, g), b(t + 4, g)
/// and c(g, 2t), c(g, 2t + 1), c(g + 8, 2t), c(g + 8, 2t + 1).
__device__ inline void multiply_add(double (&c)[4], const double (&a)[4], const double (&b)[2]) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
  asm volatile("mma.sync.aligned.m16n8k8.row.col.f64.f64.f64.f64 {%0,%1,%2,%3}, {%4,%5,%6,%7}, {%8,%9}, {%0,%1,%2,%3};"
               : "+d"(c[0]), "+d"(c[1]), "+d"(c[2]), "+d"(c[3])
               : "d"(a[0]), "d"(a[1]), "d"(a[2]), "d"(a[3]), "d"(b[0]), "d"(b[1]));
#endif
}

/// The part of a warp: its columns of both tables, and the products of a tile with them.
struct Columns {
  double odd[2][steps][2], even[2][steps][2];
  int g, t, first;  ///< columns first .. first + 15

  __device__ Columns(const double* tables, int lane, int column) : g(lane / 4), t(lane % 4), first(16 * column) {
#pragma unroll
    for (int c = 0; c < 2; ++c)
#pragma unroll
      for (int k = 0; k < steps; ++k)
#pragma unroll
        for (int i = 0; i < 2; ++i) {
          const double* const at = tables + (8 * k + t + 4 * i) * half + first + 8 * c + g;
          odd[c][k][i] = __ldg(at);
          even[c][k][i] = __ldg(at + half * half);
        }
  }

  // y[c][q][i]: entries 2 (first + 8 c + 2 t) + q of rows g (i = 0) and g + 8 of the tile. Row r, entry j of the tile
  // at x + r across + j along.
  __device__ void operator()(const double* x, int across, int along, double (&y)[2][4][2]) const {
    double sum[2][4] = {}, difference[2][4] = {};
#pragma unroll
    for (int k = 0; k < steps; ++k) {
      double u[4], v[4];
#pragma unroll
      for (int i = 0; i < 4; ++i) {
        const double* const row = x + (g + 8 * (i % 2)) * across;
        const int j = 8 * k + t + 4 * (i / 2);
        const double a = row[j * along], b = row[(n - 1 - j) * along];
        u[i] = a + b, v[i] = a - b;
      }
#pragma unroll
      for (int c = 0; c < 2; ++c) {
        multiply_add(sum[c], u, odd[c][k]);
        multiply_add(difference[c], v, even[c][k]);
      }
    }
#pragma unroll
    for (int c = 0; c < 2; ++c)
#pragma unroll
      for (int q = 0; q < 4; ++q)
#pragma unroll
        for (int i = 0; i < 2; ++i) y[c][q][i] = (q % 2 == 0 ? sum : difference)[c][2 * i + q / 2];
  }
};

// All warps of a team have read their tile.
__device__ inline void meet_team(int team) { asm volatile("bar.sync %0, %1;" ::"r"(team + 1), "r"(32 * of_team)); }

__global__ void __launch_bounds__(32 * warps, 1)
    transform_faces(const double* in, double* out, const double* tables, int faces, int stride) {
  extern __shared__ double face[];
  const int lane = int(threadIdx.x) % 32, warp = int(threadIdx.x) / 32, team = warp / of_team;
  let_next_begin();
  const Columns columns(tables, lane, warp % of_team);
  for (int i = int(threadIdx.x); i < pitch; i += 32 * warps) face[n * pitch + i] = 0;
  await_previous();
  for (int f = int(blockIdx.x); f < faces; f += int(gridDim.x)) {
    const double* const from = in + long(f) * stride;
    for (int p = 0; p < pieces; ++p) {
      for (int line = teams * tile * p + warp; line < min(teams * tile * (p + 1), n); line += warps)
        for (int i = lane; i < n; i += 32)
          __pipeline_memcpy_async(face + line * pitch + i, from + line * n + i, sizeof(double));
      __pipeline_commit();
    }
    double y[2][4][2];
#pragma unroll 1
    for (int p = 0; p < pieces; ++p) {
      if (p == 0) __pipeline_wait_prior(3);
      if (p == 1) __pipeline_wait_prior(2);
      if (p == 2) __pipeline_wait_prior(1);
      if (p == 3) __pipeline_wait_prior(0);
      __syncthreads();
      double* const lines = face + (teams * p + team) * tile * pitch;
      columns(lines, pitch, 1, y);
      meet_team(team);
#pragma unroll
      for (int c = 0; c < 2; ++c)
#pragma unroll
        for (int i = 0; i < 2; ++i) {
          double* const to = lines + (columns.g + 8 * i) * pitch + 2 * (columns.first + 8 * c + 2 * columns.t);
          *reinterpret_cast<double2*>(to) = {y[c][0][i], y[c][1][i]};
          *reinterpret_cast<double2*>(to + 2) = {y[c][2][i], y[c][3][i]};
        }
    }
    __syncthreads();
#pragma unroll 1
    for (int p = 0; p < pieces; ++p) {
      const int first = (teams * p + team) * tile;
      columns(face + first, 1, pitch, y);
#pragma unroll
      for (int c = 0; c < 2; ++c)
#pragma unroll
        for (int q = 0; q < 4; ++q)
#pragma unroll
          for (int i = 0; i < 2; ++i) {
            const int line = 2 * (columns.first + 8 * c + 2 * columns.t) + q, column = first + columns.g + 8 * i;
            if (line < n && column < n) out[long(f) * stride + line * n + column] = y[c][q][i];
          }
    }
    __syncthreads();
  }
}

}  // namespace

bool FaceProducts::take(const Device& device, const std::vector<Index>& extents) {
  if (extents.size() != 2 || extents[0] != n || extents[1] != n || device.shared_memory() < face_bytes) return false;
  int number = 0, major = 0;
  check(cudaGetDevice(&number), "asking for the device");
  check(cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, number), "asking the device");
  return major >= 9;
}

FaceProducts::FaceProducts(const Device& device) : device_(device) {
  std::vector<double> tables(std::size_t(2 * half * half), 0);
  const double scale = std::sqrt(2.0 / N);
  for (int j = 1; j <= half; ++j)
    for (int m = 0; m < half; ++m) {
      const double once = j == half ? 0.5 * scale : scale;
      tables[std::size_t((j - 1) * half + m)] = once * std::sin(std::numbers::pi * double(j * (2 * m + 1)) / N);
      if (j < half && m + 1 < half)
        tables[std::size_t((half + j - 1) * half + m)] =
            scale * std::sin(std::numbers::pi * double(j * (m + 1)) / half);
    }
  tables_ = Memory<double>(device, tables.size());
  tables_.put(tables.data());
  check(cudaFuncSetAttribute(transform_faces, cudaFuncAttributeMaxDynamicSharedMemorySize, int(face_bytes)),
        "reserving shared memory");
}

void FaceProducts::apply(const double* in, double* out, Index faces) const {
  follow(device_, transform_faces,
         {unsigned(std::min<Index>(faces, device_.multiprocessors())), 32 * warps, face_bytes},
         "the sine transform of a face", in, out, tables_.data(), int(faces), int(stride(n * n)));
}

}  // namespace bromwich::cuda
