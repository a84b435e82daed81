#pragma once
// The tableau of a step, distributed over the blocks of a march, and its principal pivots.
//
// symbol  meaning
// A       R (M + W_0) C, equilibrated (core/lcp/solution.hpp), with q^ = R q and y^ = C^{-1} y
// G(S)    principal pivot transform on the active set S of the tableau
//             w^ = A y^ + R r + R S free,    u = S C y^,    G = [P T; V U],  G(empty) = [A, R S; S C, 0],
//         so that for a known S one product gives the solution of the step and its modes,
//             (y^_S, w^_I) = E R r - P(:,S) (R r)_S + T free,    u = -V(:,S) (R r)_S + U free
// F       indices of one block pivot: P_FF^{-1} replaces P_FF, G_RF P_FF^{-1} replaces G_RF, -P_FF^{-1} G_FR replaces
//         G_FR, and the Schur complement replaces the rest, with R all other rows or columns
//
// Block b owns the rows i and the modes l of `own` neighbouring indices; the rows F of G are sent to all blocks.

#include "kernels/march_messages.cuh"
#include "kernels/march_steps.hpp"

namespace bromwich::cuda {

constexpr int chunk = 32;  ///< indices per block pivot

// Pivots before G is formed again from A. Rounding errors grow with their number; forming G takes up to n pivots.
__device__ inline int most_updates(int n) { return 200 + 4 * n; }

// For a matrix with entries of about one; smaller pivots are rounding errors.
constexpr double least_pivot = 1e-13;

// G(empty) for the indices begin .. begin + own - 1.
__device__ inline void form_rows(const StepTables& m, int own, int begin, double* G) {
  const int n = m.n, size = own * n;
  for (int i = 0; i < own; ++i)
    for (int c = threadIdx.x; c < n; c += blockDim.x) {
      const bool given = begin + i < n;
      const long at = given ? long(begin + i) * n + c : 0;
      double* const to = G + i * n + c;
      to[0] = given ? m.A[at] : 0;
      to[size] = given ? m.row_scale[begin + i] * m.sine[at] : 0;
      to[2 * size] = given ? m.sine[at] * m.column_scale[c] : 0;
      to[3 * size] = 0;
    }
}

/// Shared memory of a block, in layout order, doubles first. `marks` has one bit per index.
template <int own, bool resident>
struct BlockMemory {
  double *G, *z, *decay, *weight, *partial, *pivots, *multipliers, *input;
  int *list, *replaced;
  unsigned* marks;
  unsigned char* active;

  __device__ BlockMemory(double* memory, int n, int K, int warps) {
    G = memory, memory += resident ? 4 * own * n : 0;
    z = memory, memory += own * K;
    decay = memory, memory += own * K;
    weight = memory, memory += own * K;
    partial = memory, memory += 4 * own * warps;
    pivots = memory, memory += 2 * chunk * chunk;
    multipliers = memory, memory += 2 * own * chunk;
    input = memory, memory += own;
    list = reinterpret_cast<int*>(memory), replaced = list + n;
    marks = reinterpret_cast<unsigned*>(replaced + own);
    active = reinterpret_cast<unsigned char*>(marks + 32);
  }
  static std::size_t bytes(Index n, Index K, Index warps) {
    const Index doubles = (resident ? 4 * own * n : 0) + own * (3 * K + 4 * warps + 2 * chunk + 1) + 2 * chunk * chunk;
    return sizeof(double) * std::size_t(doubles) + sizeof(int) * std::size_t(n + own + 32) + std::size_t(n);
  }
};

/// A thread's part of the block's G: columns t, t + threads, ... of all own rows.
template <int own, int columns, bool resident>
struct Transform {
  const StepTables& m;
  const StepState& s;
  const BlockMemory<own, resident> shared;
  const int n, thread, threads, begin;            ///< begin: the first own index
  double *const P, *const T, *const V, *const U;  ///< own x n each
  unsigned number = 0;                            ///< of the last message
  int updates = 0;                                ///< pivots since G was formed from A

  __device__ Transform(const StepTables& m, const StepState& s, double* memory)
      : m(m),
        s(s),
        shared(memory, m.n, m.exponentials, blockDim.x / 32),
        n(m.n),
        thread(threadIdx.x),
        threads(blockDim.x),
        begin(blockIdx.x * own),
        P(resident ? shared.G : kept(s.transform)),
        T(P + own * n),
        V(T + own * n),
        U(V + own * n) {}

  /// The block's part of a G in global memory.
  __device__ double* kept(double* all) const { return all + long(blockIdx.x) * 4 * own * n; }
  __device__ double* rows_of(unsigned number, int i) const { return s.rows + (long(number % 2) * n + i) * 2 * n; }
  __device__ unsigned long long* mail(unsigned number, int i) const { return s.mail + (number % 2) * n + i; }

  __device__ void copy(double* to, const double* from) const {
    for (int row = 0; row < 4 * own; ++row)
      for (int c = thread; c < n; c += threads) to[row * n + c] = from[row * n + c];
  }

  /// Sets or clears the mark of the thread's q-th column. Called by all threads of a warp together.
  __device__ void mark(int q, bool marked) const {
    const unsigned all = __ballot_sync(~0u, marked);
    if (thread % 32 == 0) shared.marks[(thread + q * threads) / 32] = all;
  }

  /// Writes the marked indices to shared.list in ascending order. Begins and ends with a barrier.
  __device__ int compact() const {
    __syncthreads();
    const int lane = thread % 32;
    const unsigned word = lane < (n + 31) / 32 ? shared.marks[lane] : 0;
    int before = __popc(word);
    for (int distance = 1; distance < 32; distance *= 2) {
      const int other = __shfl_up_sync(~0u, before, distance);
      if (lane >= distance) before += other;
    }
    const int count = __shfl_sync(~0u, before, 31);
    before -= __popc(word);
#pragma unroll
    for (int q = 0; q < columns; ++q) {
      const int c = thread + q * threads;
      const unsigned mine = __shfl_sync(~0u, word, c / 32 % 32);
      const int first = __shfl_sync(~0u, before, c / 32 % 32);
      if (c < n && (mine >> lane & 1)) shared.list[first + __popc(mine & ((1u << lane) - 1))] = c;
    }
    __syncthreads();
    return count;
  }

  // First warp: writes the rows [P T] of the own indices in `mask` to global memory for the other blocks.
  __device__ void publish(unsigned mask, unsigned number) const {
    for (; mask != 0; mask &= mask - 1) {
      const int i = __ffs(mask) - 1;
      double* const to = rows_of(number, begin + i);
#pragma unroll 4
      for (int c = thread; c < n; c += 32) to[c] = P[i * n + c], to[n + c] = T[i * n + c];
    }
    __syncwarp();
    __threadfence();
  }

  // Sends the rows of G of list[first .. first + size) to all blocks, if the messages of a step have not done so.
  __device__ void share_rows(int first, int size) {
    ++number;
    if (thread < 32) {
      const int i = thread < size ? shared.list[first + thread] - begin : -1;
      publish(__reduce_or_sync(~0u, i >= 0 && i < own ? 1u << i : 0), number);
      if (thread < own && begin + thread < n) send(mail(number, begin + thread), 0, number, false);
    }
#pragma unroll
    for (int q = 0; q < columns; ++q) {
      bool none;
      if (thread + q * threads < n) receive(mail(number, thread + q * threads), number, none);
    }
    __threadfence();
    __syncthreads();
  }

  // P_FF^{-1} for F = list[0 .. size), pivot by pivot. For a P-matrix all pivots are positive; null if one is not. Rows
  // are `chunk` values apart, one warp per row.
  __device__ const double* invert(const int* F, int size) const {
    double *from = shared.pivots, *to = from + chunk * chunk;
    const int c = thread % 32, warps = threads / 32;
    for (int row = thread / 32; row < size; row += warps)
      from[row * chunk + c] = c < size ? __ldcg(rows_of(number, F[row]) + F[c]) : 0;
    __syncthreads();
    for (int f = 0; f < size; ++f) {
      const double pivot = from[f * chunk + f];
      if (!(pivot > least_pivot) || isinf(pivot)) return nullptr;
      const double inverse = 1 / pivot, above = from[f * chunk + c] * inverse;
      for (int row = thread / 32; row < size; row += warps) {
        const double left = from[row * chunk + f];
        double value = c == f ? left * inverse : from[row * chunk + c] - left * above;
        if (row == f) value = c == f ? inverse : -above;
        to[row * chunk + c] = value;
      }
      __syncthreads();
      double* const old = from;
      from = to;
      to = old;
    }
    return from;
  }

  // multipliers[f][row] of own row i: G_iF P_FF^{-1}; for i in F the row of P_FF^{-1} that replaces the old one.
  __device__ void find_multipliers(const int* F, int size, const double* inverse) const {
    for (int e = thread; e < 2 * own * size; e += threads) {
      const int row = e % (2 * own), f = e / (2 * own), i = row < own ? row : row - own;
      const double* const old = (row < own ? P : V) + i * n;
      double sum = 0;
      int at = -1;
      for (int g = 0; g < size; ++g) {
        sum += old[F[g]] * inverse[g * chunk + f];
        if (row < own && F[g] == begin + i) at = g;
      }
      shared.multipliers[e] = at < 0 ? sum : inverse[at * chunk + f];
      if (row < own && f == 0) shared.replaced[row] = at >= 0;
    }
    __syncthreads();
  }

  // Column c of [P; V] (offset 0) or [T; U] (offset n): subtracts multipliers rows_F. The columns F of P and V become
  // the multipliers.
  __device__ void update_column(const int* F, int size, int c, int offset, double* top, double* bottom) const {
    double sum[2 * own] = {};
    int at = -1;
#pragma unroll(own == 4 ? 8 : 4)
    for (int f = 0; f < size; ++f) {
      const double x = __ldcg(rows_of(number, F[f]) + offset + c);
      if (offset == 0 && F[f] == c) at = f;
#pragma unroll
      for (int i = 0; i < 2 * own; ++i) sum[i] += shared.multipliers[f * 2 * own + i] * x;
    }
#pragma unroll
    for (int i = 0; i < own; ++i) {
      const double* const exact = shared.multipliers + max(at, 0) * 2 * own;
      const double old = top[i * n + c];
      top[i * n + c] = at >= 0 ? exact[i] : (shared.replaced[i] ? 0 : old) - sum[i];
      bottom[i * n + c] = at >= 0 ? exact[own + i] : bottom[i * n + c] - sum[own + i];
    }
  }

  // Pivots on list[0 .. count). `sent`: the rows came with the last message. Ends with a barrier. False: not a
  // P-matrix.
  __device__ bool exchange(int count, bool sent) {
    for (int first = 0; first < count; first += chunk) {
      const int size = min(chunk, count - first), *const F = shared.list + first;
      if (first > 0 || !sent) share_rows(first, size);
      const double* const inverse = invert(F, size);
      if (!inverse) return false;
      find_multipliers(F, size, inverse);
      for (int c = thread; c < n; c += threads) {
        update_column(F, size, c, 0, P, V);
        update_column(F, size, c, n, T, U);
      }
      for (int f = thread; f < size; f += threads) shared.active[F[f]] ^= 1;
      __syncthreads();
    }
    updates += count;
    return true;
  }

  // The same, but forms G again for the active set after many pivots.
  __device__ bool exchange_or_form(int count, bool sent) {
    for (;;) {
      if (!exchange(count, sent)) return false;
      if (updates <= most_updates(n)) return true;
      for (int q = 0; q < columns; ++q) {
        const int c = thread + q * threads;
        mark(q, c < n && shared.active[c]);
        if (c < n) shared.active[c] = 0;
      }
      form_rows(m, own, begin, P);
      count = compact();
      updates = -count;
      sent = false;
    }
  }
};

}  // namespace bromwich::cuda
