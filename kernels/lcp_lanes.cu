// Dense complementarity problems with up to 64 unknowns, each in 8, 16 or 32 lanes of a warp.
//
// symbol    meaning
// S, k      active set and its size
// position  place in the list of S, which ends at N - 1: position N - k + c holds the c-th index of S
// a         rows of M_SS by position, two for each lane, in registers
// b         -q_S, then what is left of it
//
// A sweep eliminates pairs of columns from all rows (Gauss-Jordan), without row exchanges: no substitution follows, and
// two pivots wait for one exchange of rows through shared memory. It begins at the first position of the warp's
// largest S, so that the code is there once, whatever k. All leading minors of a P-matrix are positive; the signs of
// y_S and w decide, and problems that fail are left to lcp_blocks.cu. A group of lanes that is done takes its next
// problem at once, beside groups that are not.

#include "kernels/launch.cuh"
#include "kernels/lcp_dense.hpp"
#include "kernels/lcp_outcome.cuh"
#include "kernels/reciprocal.cuh"

#include <algorithm>
#include <cstdint>
#include <type_traits>

namespace bromwich::cuda {

namespace {

constexpr int warps = 4;         ///< of a block
constexpr int most_sweeps = 24;  ///< Newton's method on random P-matrices takes up to 15

__device__ inline int count_of(std::uint32_t set) { return __popc(set); }
__device__ inline int count_of(std::uint64_t set) { return __popcll(set); }

/// A problem of up to N unknowns in N/2 lanes. `judge`: the signs of pivots matter.
template <int N, bool judge>
struct Lanes {
  using Set = std::conditional_t<N == 64, std::uint64_t, std::uint32_t>;
  static constexpr int G = N / 2, R = 2, groups = 32 / G;
  static constexpr int blocks = N == 16 ? 4 : N == 32 ? 3 : 2;  ///< of a multiprocessor, as registers allow
  static constexpr int front = N == 64 ? 16 : 0;                ///< positions without registers: S is smaller, or left
  // Columns of M, with a column and a row of zeros for positions without index. Several copies, each in banks of its
  // own, if a half warp has several groups.
  static constexpr int copies = G >= 16 ? 1 : 16 / G;
  static constexpr int table = copies == 1 ? (N + 1) * (N + 1) : (N + 1) * (N / G + 1) * 16;
  static constexpr int line = N + 2;
  static constexpr int room = N + 4 * line;  ///< q_S or y_S by position; two pivot rows, twice
  static constexpr std::size_t shared = sizeof(double) * (warps * groups * room + table + 2 * N) + warps * groups * N;
  static_assert(shared <= 48 * 1024);

  const double* M;
  double *at_position, *lines;
  unsigned char* index;  ///< by position; N where there is none
  int n, lane, copy;

  __device__ static int at(int copy, int i, int s) {
    if constexpr (copies == 1)
      return s * (N + 1) + i;
    else
      return (s * (N / G + 1) + i / G) * 16 + copy * G + i % G;
  }
  __device__ double entry(int i, int s) const { return M[at(copy, i, s)]; }

  /// Rows of M_SS by position while they are eliminated. Slots below `from` have none.
  template <int from>
  struct Rows {
    static constexpr int start = from == 0 ? front : from * G;  ///< first column
    double a[R][N - start], b[R];
    double own[R], other[R];  ///< y = own b + other times b of the row of the same pair
    double least[R];          ///< of a positive pivot
    bool positive = true;
  };

  template <int from>
  __device__ __forceinline__ void gather(int begin, Rows<from>& rows) const {
    constexpr int start = Rows<from>::start;
    int row[R];
#pragma unroll
    for (int r = from; r < R; ++r) {
      row[r] = index[lane + G * r];
      rows.b[r] = row[r] < N ? -at_position[lane + G * r] : 0.0;
      if (judge) rows.least[r] = 16 * n * epsilon * entry(row[r], row[r]);
      rows.own[r] = 1, rows.other[r] = 0;
    }
#pragma unroll
    for (int l = start; l < N; l += 2) {
      const int two = l < begin ? 0 : *reinterpret_cast<const unsigned short*>(index + l);
#pragma unroll
      for (int r = from; r < R; ++r) rows.a[r][l - start] = rows.a[r][l + 1 - start] = 0;
      if (l < begin) continue;
#pragma unroll
      for (int h = 0; h < 2; ++h)
#pragma unroll
        for (int r = from; r < R; ++r) {
          const bool alone = r == (l + h) / G && lane == (l + h) % G && row[r] == N;
          rows.a[r][l + h - start] = alone ? 1.0 : entry(row[r], h == 0 ? two & 255 : two >> 8);
        }
    }
  }

  /// Eliminates columns c and c + 1, c even, from all other rows. c is known when it is compiled.
  template <int from>
  __device__ __forceinline__ void eliminate_pair(int c, Rows<from>& rows) const {
    constexpr int start = Rows<from>::start;
    const int slot = c / G;
    double *first = lines + (c / 2 % 2) * 2 * line, *second = first + line;
    const bool mine = lane / 2 == c % G / 2, even = lane % 2 == 0;
    if (mine) {
      double* to = even ? first : second;
#pragma unroll
      for (int l = c; l < N; l += 2)
        *reinterpret_cast<double2*>(to + l) = {rows.a[slot][l - start], rows.a[slot][l + 1 - start]};
      to[N] = rows.b[slot];
    }
    __syncwarp();
    const double2 top = *reinterpret_cast<const double2*>(first + c);
    const double2 low = *reinterpret_cast<const double2*>(second + c);
    const double determinant = top.x * low.y - top.y * low.x, over = reciprocal(determinant);
    double f[R], g[R];
#pragma unroll
    for (int r = from; r < R; ++r) {
      const double x = rows.a[r][c - start] * over, z = rows.a[r][c + 1 - start] * over;
      f[r] = x * low.y - z * low.x;
      g[r] = z * top.x - x * top.y;
    }
    if (mine) {
      f[slot] = g[slot] = 0;
      rows.own[slot] = over * (even ? low.y : top.x);
      rows.other[slot] = -over * (even ? top.y : low.x);
      if (judge)
        rows.positive = rows.positive && (even ? top.x > rows.least[slot] : determinant > rows.least[slot] * top.x);
    }
#pragma unroll
    for (int l = c + 2; l < N; l += 2) {
      const double2 p = *reinterpret_cast<const double2*>(first + l);
      const double2 t = *reinterpret_cast<const double2*>(second + l);
#pragma unroll
      for (int r = from; r < R; ++r) {
        rows.a[r][l - start] = fma(-g[r], t.x, fma(-f[r], p.x, rows.a[r][l - start]));
        rows.a[r][l + 1 - start] = fma(-g[r], t.y, fma(-f[r], p.y, rows.a[r][l + 1 - start]));
      }
    }
    const double p = first[N], t = second[N];
#pragma unroll
    for (int r = from; r < R; ++r) rows.b[r] = fma(-g[r], t, fma(-f[r], p, rows.b[r]));
  }

  /// y_S from q_S; positions below `begin` are unused by the whole warp. Returns whether all pivots were positive, if
  /// that is judged.
  template <int from>
  __device__ bool eliminate(int begin) const {
    Rows<from> rows;
    gather(begin, rows);
#pragma unroll
    for (int c = Rows<from>::start; c < N; c += 2)
      if (c >= begin) eliminate_pair(c, rows);
#pragma unroll
    for (int r = from; r < R; ++r) {
      const double partner = __shfl_xor_sync(~0u, rows.b[r], 1);
      at_position[lane + G * r] = rows.own[r] * rows.b[r] + rows.other[r] * partner;
    }
    return rows.positive;
  }

  __device__ bool eliminate(int begin) const {
    if constexpr (N == 16)  // larger ones: instructions are read more slowly than the half of them is worth
      if (begin >= G) return eliminate<1>(begin);
    return eliminate<0>(begin);
  }

  /// M and its scales in shared memory, with zeros beyond n.
  __device__ static void fill(const DenseProblems& m, double* M, double* row_scale, double* column_scale) {
    const int size = m.n * m.n;
    for (int e = threadIdx.x; e < table; e += blockDim.x) M[e] = 0;
    __syncthreads();
    for (int e = threadIdx.x; e < size * copies; e += blockDim.x)
      M[at(e / size, e % size / m.n, e % m.n)] = m.M[e % size];
    for (int i = threadIdx.x; i < N; i += blockDim.x) {
      row_scale[i] = i < m.n ? m.row_scale[i] : 0;
      column_scale[i] = i < m.n ? m.column_scale[i] : 0;
    }
    __syncthreads();
  }

  /// Lists S with its q. Returns the position of each own index that is in S.
  __device__ void list(Set set, const double (&q)[R], int (&position)[R]) const {
#pragma unroll
    for (int r = 0; r < R; ++r) index[lane + G * r] = N;
    __syncwarp();
#pragma unroll
    for (int r = 0; r < R; ++r) {
      const int i = lane + G * r;
      position[r] = N - count_of(Set(set >> i));
      if (set >> i & 1) index[position[r]] = (unsigned char)(i), at_position[position[r]] = q[r];
    }
    __syncwarp();
  }

  /// value <- w, and y where i is in S.
  __device__ void evaluate(int begin, Set set, const double (&q)[R], const int (&position)[R],
                           double (&value)[R]) const {
    for (int r = 0; r < R; ++r) value[r] = q[r];
#pragma unroll 2
    for (int c = begin; c < N; c += 2) {
      const double2 y = *reinterpret_cast<const double2*>(at_position + c);
      const int two = *reinterpret_cast<const unsigned short*>(index + c);
#pragma unroll
      for (int r = 0; r < R; ++r)
        value[r] = fma(entry(lane + G * r, two >> 8), y.y, fma(entry(lane + G * r, two & 255), y.x, value[r]));
    }
#pragma unroll
    for (int r = 0; r < R; ++r)
      if (set >> (lane + G * r) & 1) value[r] = at_position[position[r]];
  }
};

template <int N, bool judge>
__global__ void __launch_bounds__(32 * warps, Lanes<N, judge>::blocks)
    newton_in_lanes(LcpArrays arrays, DenseProblems m, int first, int rows, LeftRows left, OutcomeTarget target) {
  using L = Lanes<N, judge>;
  using Set = typename L::Set;
  constexpr int R = L::R, G = L::G, groups = L::groups;
  extern __shared__ __align__(16) double shared[];
  double *M = shared + warps * groups * L::room, *row_scale = M + L::table, *column_scale = row_scale + N;
  const int n = m.n;
  let_next_begin();
  L::fill(m, M, row_scale, column_scale);
  await_previous();
  const int group = int(threadIdx.x) % 32 / G, place = int(threadIdx.x) / G, lane = int(threadIdx.x) % G;
  double* room = shared + place * L::room;
  unsigned char* indices = reinterpret_cast<unsigned char*>(column_scale + N) + place * N;
  const L lanes{M, room, room + N, indices, n, lane, group % L::copies};
  const unsigned members = G == 32 ? ~0u : (1u << (G % 32)) - 1;
  const auto set_of = [&](const bool(&is)[R]) {
    Set set = 0;
    for (int r = 0; r < R; ++r) set |= Set(__ballot_sync(~0u, is[r]) >> (group * G) & members) << (G * r);
    return set;
  };
  const auto largest_of_group = [&](double mine) {
    for (int s = G / 2; s > 0; s /= 2) mine = larger(mine, __shfl_xor_sync(~0u, mine, s));
    return mine;
  };
  Outcomes outcomes(target);
  const int together = int(gridDim.x) * warps * groups;
  int j = first + int(blockIdx.x) * warps * groups + place - together, sweeps = 0;
  double q[R] = {}, old[R] = {}, size = 0;
  Set set = 0;
  bool done = true;
  while (true) {
    if (__any_sync(~0u, done)) {  // the next problem of these groups
      if (done) {
        j += together;
        sweeps = 0;
        const long at = long(j) * arrays.stride + lane;
        for (int r = 0; r < R; ++r) {
          const bool there = j < rows && lane + G * r < n;
          q[r] = there ? row_scale[lane + G * r] * (arrays.r[at + G * r] + arrays.v[at + G * r]) : 0;
          old[r] = there ? arrays.y[at + G * r] : 0;
        }
      }
      bool active[R];
      double largest = 0;
      for (int r = 0; r < R; ++r) active[r] = old[r] > 0, largest = larger(fabs(q[r]), largest);
      const Set given = set_of(active);
      largest = largest_of_group(largest);
      if (done) set = given, size = largest;
      if (__all_sync(~0u, j >= rows)) break;
    }
    int most = count_of(set), position[R];
    for (int s = 16; s >= G; s /= 2) most = max(most, __shfl_xor_sync(~0u, most, s));
    const bool fits = N - most >= L::front;
    const int begin = (N - most) & ~1;
    lanes.list(set, q, position);
    const bool positive = fits && lanes.eliminate(begin);
    __syncwarp();
    ++sweeps;
    double value[R];
    lanes.evaluate(begin, set, q, position, value);
    bool wrong[R];
    for (int r = 0; r < R; ++r) wrong[r] = value[r] < -16 * epsilon * size;
    const Set flips = set_of(wrong);
    done = j < rows && (!fits || flips == 0 || sweeps >= most_sweeps);
    if (__any_sync(~0u, done)) {
      const bool accepted = !judge || (__ballot_sync(~0u, positive) >> (group * G) & members) == members;
      double change = 0, magnitude = 0;
      for (int r = 0; r < R; ++r) {
        const double y = set >> (lane + G * r) & 1 ? value[r] : 0.0;
        value[r] = y <= 0 ? 0 : column_scale[lane + G * r] * y;  // keeps a NaN
        change = larger(fabs(value[r] - old[r]), change);
        magnitude = larger(fabs(value[r]), magnitude);
      }
      change = largest_of_group(change), magnitude = largest_of_group(magnitude);
      const bool solved = fits && flips == 0 && accepted && isfinite(size) && isfinite(change) && isfinite(magnitude);
      if (done && solved)
        for (int r = 0; r < R; ++r)
          if (lane + G * r < n) arrays.y[long(j) * arrays.stride + lane + G * r] = value[r];
      if (done && lane == 0) {
        if (solved)
          outcomes.solved(j, sweeps, change, magnitude);
        else
          left.rows[atomicAdd(left.count, 1)] = j;
      }
    }
    set ^= flips;
    __syncwarp();
  }
  outcomes.template finish<false, false>();
}

template <int N>
void launch(const Device& device, const LcpArrays& arrays, const DenseProblems& m, int first, int rows, LeftRows left,
            const OutcomeTarget& target) {
  using L = Lanes<N, false>;
  const int of_block = warps * L::groups, most = L::blocks * device.multiprocessors();
  const unsigned blocks = unsigned(std::min((rows - first + of_block - 1) / of_block, most));
  follow(device, m.least ? newton_in_lanes<N, true> : newton_in_lanes<N, false>, {blocks, 32 * warps, L::shared},
         "starting the complementarity problems", arrays, m, first, rows, left, target);
}

}  // namespace

void solve_in_lanes(const Device& device, const LcpArrays& arrays, const DenseProblems& m, int first, int rows,
                    LeftRows left, const OutcomeTarget& target) {
  check(cudaMemsetAsync(left.count, 0, sizeof(int), device.stream()), "clearing device memory");
  (m.n <= 16 ? launch<16> : m.n <= 32 ? launch<32> : launch<64>)(device, arrays, m, first, rows, left, target);
}

}  // namespace bromwich::cuda
