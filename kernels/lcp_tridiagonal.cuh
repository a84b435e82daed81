#pragma once
// One tridiagonal complementarity problem in a group of T threads, K consecutive rows per thread: layout in shared
// memory, and a thread's part of the Newton sweeps.

#include "core/base/types.hpp"
#include "kernels/lcp_outcome.cuh"
#include "kernels/tridiagonal.cuh"

#include <cuda_pipeline_primitives.h>

namespace bromwich::cuda {

/// The entries of R M C and the scales: one value for all rows (`uniform`), or row i of thread t at [i T + t].
template <bool uniform>
struct Coefficients {
  const double *lower, *diagonal, *upper, *row_scale, *column_scale;
};
template <>
struct Coefficients<true> {
  double lower, diagonal, upper, row_scale, column_scale;
};

/// Parameters common to all problems of a batch, besides the matrix.
struct Problem {
  int n, first, rows, cap;  ///< cap: largest number of sweeps
  bool least;
  double shift;
  int reach;
};

/// Layout of a problem's rows in shared memory, in pieces of two rows (16 bytes). The pieces of a thread are rotated so
/// that eight neighbouring threads read without bank conflicts.
template <int K>
struct Place {
  static constexpr int pieces = K / 2;
  __device__ static int of(int t, int piece) { return t * pieces + (piece ^ (t * pieces / 8 % pieces)); }
  __device__ static int of(int piece) { return of(piece / pieces, piece % pieces); }
};

/// r, v and y of one problem in shared memory.
template <int T, int K>
struct Slot {
  double2 *r, *v, *y;
  __device__ explicit Slot(double* shared)
      : r(reinterpret_cast<double2*>(shared)), v(r + T * K / 2), y(v + T * K / 2) {}
  static constexpr int size = 3 * T * K;

  /// Row i of r, v or y.
  __device__ static double& value(double2* of, int i) {
    return reinterpret_cast<double*>(of + Place<K>::of(i / 2))[i % 2];
  }

  // Short rows need not be 16-byte aligned.
  static constexpr bool by_value = T < 32;

  __device__ void fetch(const LcpArrays& arrays, int n, int j, int t) {
    const long at = long(j) * arrays.stride;
    if constexpr (by_value) {
      for (int i = t; i < n; i += T) {
        const auto copy = [&](double2* to, const double* from) {
          __pipeline_memcpy_async(&value(to, i), from + at + i, 8);
        };
        copy(r, arrays.r), copy(y, arrays.y);
        if (arrays.v) copy(v, arrays.v);
      }
    } else {
      for (int piece = t; 2 * piece < arrays.stride; piece += T) {
        const int place = Place<K>::of(piece);
        __pipeline_memcpy_async(r + place, arrays.r + at + 2 * piece, 16);
        if (arrays.v) __pipeline_memcpy_async(v + place, arrays.v + at + 2 * piece, 16);
        __pipeline_memcpy_async(y + place, arrays.y + at + 2 * piece, 16);
      }
    }
  }
  __device__ void store_y(const LcpArrays& arrays, int n, int j, int t) const {
    double* const to = arrays.y + long(j) * arrays.stride;
    if constexpr (by_value) {
      for (int i = t; i < n; i += T) to[i] = value(y, i);
    } else {
      for (int piece = t; 2 * piece < arrays.stride; piece += T)
        reinterpret_cast<double2*>(to)[piece] = y[Place<K>::of(piece)];
    }
  }
};

/// Outcome of a problem.
struct Solution {
  bool is;                   ///< false: unsolved
  int sweeps;                ///< negative if they did not settle
  double change, magnitude;  ///< of y

  __device__ void count(Outcomes& outcomes, int j) const {
    if (is)
      outcomes.solved(j, sweeps, change, magnitude);
    else
      outcomes.unsolved(j, abs(sweeps));
  }
};

/// One thread's part of a problem with M + D I instead of M and q = r + v - D y, y the old one. q overwrites r in the
/// slot.
template <int T, int K, bool uniform>
struct Part {
  Group<T>& group;
  const Coefficients<uniform>& M;
  Slot<T, K> slot;
  int t;
  unsigned valid;  ///< bit i: row t K + i exists
  double shift;    ///< D
  int reach;       ///< distance in threads up to which rows are coupled
  unsigned active = 0;
  double size = 0;  ///< largest |q_i|
  bool positive = true;
  double x[K], above, below;  ///< x of this thread's rows, of the row before and of the row after

  __device__ double coefficient(const double* all, int i) const { return __ldg(all + i * T + t); }
  __device__ double coefficient(double one, int) const { return one; }
  __device__ double2& at(double2* values, int piece) const { return values[Place<K>::of(t, piece)]; }

  __device__ void take_up() {
#pragma unroll
    for (int p = 0; p < K / 2; ++p) {
      const double2 r = at(slot.r, p), v = at(slot.v, p), y = at(slot.y, p);
      double2 q{coefficient(M.row_scale, 2 * p) * (r.x + v.x - shift * y.x),
                coefficient(M.row_scale, 2 * p + 1) * (r.y + v.y - shift * y.y)};
      if (y.x > 0) active |= 1u << 2 * p;
      if (y.y > 0) active |= 2u << 2 * p;
      if (!(valid >> 2 * p & 1)) q.x = 1;
      if (!(valid >> 2 * p & 2)) q.y = 1;
      size = larger(larger(fabs((valid >> 2 * p & 1) ? q.x : 0), fabs((valid >> 2 * p & 2) ? q.y : 0)), size);
      at(slot.r, p) = q;
    }
    active &= valid;
    size = group.largest(size);
  }

  // Computes x for the current active set.
  __device__ void substitute() {
    double a[K], b[K], c[K];
#pragma unroll
    for (int i = 0; i < K; ++i) {
      const bool on = active >> i & 1;
      const double2 q = at(slot.r, i / 2);
      a[i] = on ? coefficient(M.lower, i) : 0;
      b[i] = on ? coefficient(M.diagonal, i) : 1;
      c[i] = on ? coefficient(M.upper, i) : 0;
      x[i] = on ? -(i % 2 == 0 ? q.x : q.y) : 0;
    }
    positive = solve_tridiagonal<K>(group, reach, a, b, c, x, above, below);
  }

  // Flips the indices with the wrong sign; returns whether this thread had any.
  __device__ bool exchange(double tolerance) {
    unsigned flips = 0;
#pragma unroll
    for (int i = 0; i < K; ++i) {
      const double2 q = at(slot.r, i / 2);
      const double w = (i % 2 == 0 ? q.x : q.y) + coefficient(M.diagonal, i) * x[i] +
                       (coefficient(M.lower, i) * (i > 0 ? x[(i + K - 1) % K] : above) +
                        coefficient(M.upper, i) * (i + 1 < K ? x[(i + 1) % K] : below));
      if (((active >> i & 1) ? x[i] : w) < -tolerance) flips |= 1u << i;
    }
    flips &= valid;
    active ^= flips;
    return flips != 0;
  }

  // Returns the number of sweeps, negative if they did not settle. The groups of a warp run until all have settled.
  __device__ int sweep(int cap) {
    // Rounding error of M y + q: a few operations of the size of q, for a well-scaled M.
    const double tolerance = 16 * epsilon * size;
    bool settled = false;
    int sweeps = 0;
    for (int count = 1; count <= cap; ++count) {
      if (!settled) sweeps = count;
      substitute();
      settled = !group.any(exchange(tolerance));
      if (!group.any_together(!settled)) break;
    }
    return settled ? sweeps : -sweeps;
  }

  // y from x, compared with the old y. Keeps a NaN.
  __device__ void give_back(bool keep, double& change, double& magnitude) {
#pragma unroll
    for (int p = 0; p < K / 2; ++p) {
      const double2 old = at(slot.y, p);
      const double2 y{x[2 * p] <= 0 ? 0 : coefficient(M.column_scale, 2 * p) * x[2 * p],
                      x[2 * p + 1] <= 0 ? 0 : coefficient(M.column_scale, 2 * p + 1) * x[2 * p + 1]};
      change = larger(larger(fabs(y.x - old.x), fabs(y.y - old.y)), change);
      magnitude = larger(larger(fabs(y.x), fabs(y.y)), magnitude);
      if (keep) at(slot.y, p) = y;
    }
    group.largest(change, magnitude);
  }

  // Solves the problem. If there is a solution it replaces y in the slot. Same result in all threads of the group.
  __device__ Solution solve(int cap, bool least) {
    take_up();
    Solution found{false, sweep(cap), 0, 0};
    // For a Z-matrix the solution is the least one exactly if the active block has positive pivots.
    const bool wanted = !(least && group.any(!positive)) && found.sweeps > 0;
    give_back(wanted, found.change, found.magnitude);
    found.is = wanted && isfinite(size) && isfinite(found.change) && isfinite(found.magnitude);
    return found;
  }
};

}  // namespace bromwich::cuda
