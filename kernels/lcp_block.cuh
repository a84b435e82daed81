#pragma once
// One dense complementarity problem, solved by a block.
//
// symbol  meaning
// S, k    active set and its size; `index` lists it
// A       M_SS and q_S beside it, k x (k + 1), in shared memory or in a slab of the block; M_SS becomes its inverse
// where
//         that is wanted, q_S becomes M_SS^{-1} q_S
// d       shift of the diagonal, eps R C for M + eps I
//
// A sweep eliminates by blocks of eight columns from all rows (Gauss-Jordan), without row exchanges, as all leading
// minors of a P-matrix are positive. Indices with the wrong sign are exchanged all at once; if that lessens their
// number too seldom, the last one alone, until it does: this ends for P-matrices (Judice and Pires, Computers and
// Operations Research 21, 1994).
//
// Semidefinite M: y_eps of M + eps I tends to the solution of least norm, with one active set S for all small eps. On S
// the refinement y <- y - (A + d)^{-1} (q_S + A y) tends to M_SS^+ (-q_S), as the inverse maps the range of M_SS to
// itself. Whether S is right is judged as on the host (core/lcp/least_norm.hpp).

#include "kernels/lcp_dense.hpp"
#include "kernels/lcp_outcome.cuh"
#include "kernels/reciprocal.cuh"

#include <cmath>

namespace bromwich::cuda {

class BlockProblem {
 public:
  static constexpr int most_threads = 512;
  /// Values in shared memory beside A.
  static constexpr Index beside(Index n) { return 5 * n + panel * panel + most_threads / 32 + (5 * n + 11) / 8; }

  __device__ BlockProblem(const DenseProblems& m, double* shared, int room, double* slab)
      : m_(m), n_(m.n), room_(room) {
    q = shared, value = q + n_, y = value + n_, step_ = y + n_, slope_ = step_ + n_;
    D_ = slope_ + n_, sums_ = D_ + panel * panel, shared_ = sums_ + most_threads / 32;
    index = reinterpret_cast<int*>(shared_ + room);
    count_ = index + n_;
    active = reinterpret_cast<unsigned char*>(count_ + 1);
    slab_ = slab;
  }

  double *q, *value;  ///< by row: R q; w, and y where i is in S
  double* y;          ///< by position in S, in scaled units
  int* index;
  unsigned char* active;
  int k = 0, sweeps = 0;
  double size = 0;        ///< largest |q_i|
  bool positive = false;  ///< all pivots of the last sweep

  __device__ void load(const LcpArrays& arrays, long at) {
    double mine = 0;
    for (int i = threadIdx.x; i < n_; i += blockDim.x) {
      q[i] = m_.row_scale[i] * (arrays.r[at + i] + arrays.v[at + i]);
      active[i] = arrays.y[at + i] > 0;
      mine = larger(fabs(q[i]), mine);
    }
    size = largest_of_block(mine);
    sweeps = 0;
  }

  /// Exchanges active sets of M + d until the signs are right.
  __device__ bool newton(double eps) {
    int fewest = n_ + 1, patience = most_patience;
    for (int sweep = 0; sweep < most_sweeps; ++sweep) {
      ++sweeps;
      list();
      solve(eps);
      int wrong = 0, last = -1;
      for (int i = threadIdx.x; i < n_; i += blockDim.x)
        if (value[i] < -16 * epsilon * size) ++wrong, last = i;
      const int all = int(sum_of_block(wrong)), end = int(largest_of_block(last + 1)) - 1;
      if (all == 0) return true;
      const bool exchange_all = all < fewest || patience > 0;
      patience = all < fewest ? most_patience : patience - 1;
      fewest = min(fewest, all);
      for (int i = threadIdx.x; i < n_; i += blockDim.x)
        if (value[i] < -16 * epsilon * size && (exchange_all || i == end)) active[i] ^= 1;
      __syncthreads();
    }
    return false;
  }

  /// The solution of least norm, with shifts from `eps` on; false if none of them shows it.
  __device__ bool least_norm(double eps) {
    for (const double end = 1e-10 * eps; eps > end; eps *= 1e-2)
      if (newton(eps) && takes_limit()) return true;
    return false;
  }

  __device__ double largest_of_block(double mine) {
    return over_block(mine, [](double a, double b) { return larger(a, b); });
  }

 private:
  static constexpr int panel = 8, rows_together = 4;
  static constexpr int most_sweeps = 200, most_patience = 10, most_refinements = 60;

  __device__ int warps() const { return int(blockDim.x) / 32; }
  __device__ int warp() const { return int(threadIdx.x) / 32; }
  __device__ int lane() const { return int(threadIdx.x) % 32; }
  __device__ int width() const { return k + 1; }
  __device__ double* A() const { return k * width() <= room_ ? shared_ : slab_; }

  template <class Join>
  __device__ double over_block(double mine, Join join) {
    for (int s = 16; s > 0; s /= 2) mine = join(mine, __shfl_xor_sync(~0u, mine, s));
    __syncthreads();
    if (lane() == 0) sums_[warp()] = mine;
    __syncthreads();
    mine = sums_[0];
    for (int w = 1; w < warps(); ++w) mine = join(mine, sums_[w]);
    return mine;
  }
  __device__ double sum_of_block(double mine) {
    return over_block(mine, [](double a, double b) { return a + b; });
  }

  // index, k.
  __device__ void list() {
    if (warp() == 0) {
      int count = 0;
      for (int from = 0; from < n_; from += 32) {
        const bool is = from + lane() < n_ && active[from + lane()];
        const unsigned which = __ballot_sync(~0u, is);
        if (is) index[count + __popc(which & ((1u << lane()) - 1))] = from + lane();
        count += __popc(which);
      }
      if (lane() == 0) *count_ = count;
    }
    __syncthreads();
    k = *count_;
  }

  __device__ double shift(double eps, int i) const { return eps * m_.row_scale[i] * m_.column_scale[i]; }

  // The inverse of a block on the diagonal, b x b, in D_; by the first warp.
  __device__ bool invert_pivots(int from, int b) {
    bool fine = true;
    for (int c = 0; c < b; ++c) {
      const double pivot = D_[c * panel + c], over = reciprocal(pivot);
      const int s = index[from + c];
      fine = fine && pivot > 16 * n_ * epsilon * m_.M[long(s) * n_ + s];
      double fresh[2];
      for (int h = 0; h < 2; ++h) {
        const int e = lane() + 32 * h, i = e / panel, l = e % panel;
        const double of_row = i < b && l < b ? D_[c * panel + l] : 0,
                     of_column = i < b && l < b ? D_[i * panel + c] : 0;
        if (i == c)
          fresh[h] = l == c ? over : of_row * over;
        else
          fresh[h] = l == c ? -of_column * over : D_[e] - of_column * of_row * over;
      }
      __syncwarp();
      for (int h = 0; h < 2; ++h)
        if ((lane() + 32 * h) / panel < b && lane() % panel < b) D_[lane() + 32 * h] = fresh[h];
      __syncwarp();
    }
    return fine;
  }

  // y_S of M + d; also the inverse.
  template <bool inverse>
  __device__ void eliminate(double eps) {
    double* a = A();
    for (int i = warp(); i < k; i += warps()) {
      const double* row = m_.M + long(index[i]) * n_;
#pragma unroll 4
      for (int l = lane(); l < k; l += 32) a[i * width() + l] = row[index[l]] + (i == l ? shift(eps, index[i]) : 0);
      if (lane() == 0) a[i * width() + k] = q[index[i]];
    }
    bool fine = true;
    for (int from = 0; from < k; from += panel) {
      const int b = min(panel, k - from);
      __syncthreads();
      for (int e = threadIdx.x; e < panel * panel; e += blockDim.x)
        D_[e] = e / panel < b && e % panel < b ? a[(from + e / panel) * width() + from + e % panel] : 0;
      __syncthreads();
      if (warp() == 0) fine = invert_pivots(from, b) && fine;
      __syncthreads();
      for (int l = (inverse ? 0 : from + b) + int(threadIdx.x); l <= k; l += blockDim.x)
        if (l < from || l >= from + b) multiply_panel(a, from, b, l);
      __syncthreads();
      for (int i = warp() * rows_together; i < k; i += warps() * rows_together) eliminate_rows<inverse>(a, i, from, b);
      if constexpr (inverse) {
        __syncthreads();
        for (int e = threadIdx.x; e < panel * panel; e += blockDim.x)
          if (e / panel < b && e % panel < b) a[(from + e / panel) * width() + from + e % panel] = D_[e];
      }
    }
    positive = largest_of_block(fine ? 0 : 1) == 0;
    for (int c = threadIdx.x; c < k; c += blockDim.x) y[c] = -a[c * width() + k];
    __syncthreads();
  }

  // Column l of the rows of the panel, times the inverse of its pivots.
  __device__ void multiply_panel(double* a, int from, int b, int l) {
    double old[panel];
#pragma unroll
    for (int c = 0; c < panel; ++c) old[c] = c < b ? a[(from + c) * width() + l] : 0;
    for (int c = 0; c < b; ++c) {
      double sum = 0;
#pragma unroll
      for (int h = 0; h < panel; ++h) sum += D_[c * panel + h] * old[h];
      a[(from + c) * width() + l] = sum;
    }
  }

  // Columns of the panel eliminated from rows i .. i + 3, if they are not in it; by a warp.
  template <bool inverse>
  __device__ void eliminate_rows(double* a, int i, int from, int b) {
    double f[rows_together][panel];
    bool other[rows_together];
#pragma unroll
    for (int r = 0; r < rows_together; ++r) {
      other[r] = i + r < k && (i + r < from || i + r >= from + b);
#pragma unroll
      for (int c = 0; c < panel; ++c) f[r][c] = other[r] && c < b ? a[(i + r) * width() + from + c] : 0;
    }
    __syncwarp();
    for (int l = (inverse ? 0 : from + b) + lane(); l <= k; l += 32) {
      if (l >= from && l < from + b) continue;
      double u[panel];
#pragma unroll
      for (int c = 0; c < panel; ++c) u[c] = c < b ? a[(from + c) * width() + l] : 0;
#pragma unroll
      for (int r = 0; r < rows_together; ++r) {
        if (!other[r]) continue;
        double sum = a[(i + r) * width() + l];
#pragma unroll
        for (int c = 0; c < panel; ++c) sum -= f[r][c] * u[c];
        a[(i + r) * width() + l] = sum;
      }
    }
    if constexpr (inverse) {
      if (lane() >= b) return;
#pragma unroll
      for (int r = 0; r < rows_together; ++r) {
        if (!other[r]) continue;
        double sum = 0;
#pragma unroll
        for (int c = 0; c < panel; ++c) sum -= f[r][c] * D_[c * panel + lane()];
        a[(i + r) * width() + from + lane()] = sum;
      }
    }
  }

  // out <- A^{-1} times the values by position.
  template <class Value>
  __device__ void apply_inverse(Value value_at, double* out) {
    const double* a = A();
    for (int c = warp(); c < k; c += warps()) {
      double sum = 0;
      for (int l = lane(); l < k; l += 32) sum += a[c * width() + l] * value_at(l);
      for (int s = 16; s > 0; s /= 2) sum += __shfl_xor_sync(~0u, sum, s);
      if (lane() == 0) out[c] = sum;
    }
    __syncthreads();
  }

  // take(i, sum_S M_is y_s, the same of absolute values), by the first lane of a warp.
  template <class Take>
  __device__ void multiply(const double* by_position, Take take) {
    for (int i = warp(); i < n_; i += warps()) {
      double sum = 0, terms = 0;
      for (int c = lane(); c < k; c += 32) {
        const double term = m_.M[long(i) * n_ + index[c]] * by_position[c];
        sum += term, terms += fabs(term);
      }
      for (int s = 16; s > 0; s /= 2) sum += __shfl_xor_sync(~0u, sum, s), terms += __shfl_xor_sync(~0u, terms, s);
      if (lane() == 0) take(i, sum, terms);
    }
    __syncthreads();
  }

  // y of M + d, value. The inverse of a semidefinite matrix with a small shift is refined, and kept for its limit.
  __device__ void solve(double eps) {
    if (eps > 0) {
      eliminate<true>(eps);
      multiply(y, [&](int i, double sum, double) { value[i] = q[i] + sum; });
      apply_inverse([&](int c) { return value[index[c]] + shift(eps, index[c]) * y[c]; }, step_);
      for (int c = threadIdx.x; c < k; c += blockDim.x) y[c] -= step_[c];
      __syncthreads();
    } else {
      eliminate<false>(0);
    }
    multiply(y, [&](int i, double sum, double) { value[i] = q[i] + sum; });
    for (int c = threadIdx.x; c < k; c += blockDim.x) value[index[c]] = y[c];
    __syncthreads();
  }

  // out <- out - (A + d)^{-1} (right_S + M_SS out) until it stays. Changes value.
  template <class Right>
  __device__ void refine(Right right, double* out) {
    double before = INFINITY;
    for (int count = 0; count < most_refinements; ++count) {
      multiply(out, [&](int i, double sum, double) { value[i] = sum; });
      apply_inverse([&](int c) { return right(c) + value[index[c]]; }, step_);
      double mine = 0, whole = 0;
      for (int c = threadIdx.x; c < k; c += blockDim.x) {
        mine = larger(fabs(step_[c]), mine);
        out[c] -= step_[c];
        whole = larger(fabs(out[c]), whole);
      }
      const double change = largest_of_block(mine), now = largest_of_block(whole);
      if (!(change > epsilon * now) || (count > 2 && !(change < before))) break;
      before = change;
    }
    __syncthreads();
  }

  // After `newton`: y of the limit eps -> 0 on S, with value = y and active where it is positive. If that is not the
  // solution of least norm, S stays active.
  __device__ bool takes_limit() {
    refine([&](int c) { return q[index[c]]; }, y);
    const double top = largest_in_units(y);
    for (int c = threadIdx.x; c < k; c += blockDim.x) {
      slope_[c] = y[c];
      if (!(m_.column_scale[index[c]] * y[c] > 1e-12 * top)) y[c] = 0;
    }
    __syncthreads();
    bool fine = solves();
    if (!fine) {
      for (int c = threadIdx.x; c < k; c += blockDim.x) y[c] = fmax(slope_[c], 0.0);
      __syncthreads();
      fine = solves();
    }
    fine = fine && is_least();
    __syncthreads();
    for (int i = threadIdx.x; i < n_; i += blockDim.x) active[i] = 0;
    __syncthreads();
    for (int c = threadIdx.x; c < k; c += blockDim.x) {
      active[index[c]] = !fine || y[c] > 0;
      value[index[c]] = y[c];
    }
    __syncthreads();
    return fine;
  }

  __device__ double largest_in_units(const double* by_position) {
    double mine = 0;
    for (int c = threadIdx.x; c < k; c += blockDim.x)
      mine = larger(fabs(m_.column_scale[index[c]] * by_position[c]), mine);
    return largest_of_block(mine);
  }

  // Marks rows: 1 where y > 0.
  __device__ void mark() {
    for (int i = threadIdx.x; i < n_; i += blockDim.x) active[i] = 0;
    __syncthreads();
    for (int c = threadIdx.x; c < k; c += blockDim.x) active[index[c]] = y[c] > 0;
    __syncthreads();
  }

  // As is_solution of core/lcp/solution.hpp.
  __device__ bool solves() {
    mark();
    const double rounding = 16 * (n_ + 4) * epsilon;
    bool wrong = false;
    multiply(y, [&](int i, double sum, double terms) {
      const double w = q[i] + sum, level = rounding * (fabs(q[i]) + terms + size);
      if (!active[i] && w > level) return;
      wrong = wrong || !(level <= 1e-4 * size) || !(w >= -level) || (active[i] && !(w <= level));
    });
    return largest_of_block(wrong ? 1 : 0) == 0;
  }

  // As Monotone::is_least of core/lcp/least_norm.cpp: with M_SS y' = -y_S, y + eps y' solves the problem of M + eps I
  // up to eps^2. Marks rows: 1 in S, 2 others where w = 0.
  __device__ bool is_least() {
    multiply(y, [&](int i, double sum, double terms) {
      active[i] = fabs(q[i] + sum) <= 1e-12 * (fabs(q[i]) + terms) ? 2 : 0;
    });
    for (int c = threadIdx.x; c < k; c += blockDim.x) active[index[c]] = 1, slope_[c] = 0;
    __syncthreads();
    refine([&](int c) { return shift(1, index[c]) * y[c]; }, slope_);
    const double top = largest_in_units(slope_);
    bool wrong = false;
    for (int i = threadIdx.x; i < n_; i += blockDim.x) value[i] = 0;
    __syncthreads();
    for (int c = threadIdx.x; c < k; c += blockDim.x) {
      value[index[c]] = shift(1, index[c]) * y[c];
      wrong = wrong || (y[c] == 0 && m_.column_scale[index[c]] * slope_[c] < -1e-9 * top);
    }
    __syncthreads();
    multiply(slope_, [&](int i, double sum, double terms) {
      const double rise = sum + value[i], level = 1e-9 * (terms + value[i]);
      wrong = wrong || (active[i] != 0 && rise < -level) || (active[i] == 1 && rise > level);
    });
    return largest_of_block(wrong ? 1 : 0) == 0;
  }

  const DenseProblems& m_;
  int n_, room_;
  double *step_, *slope_, *D_, *sums_, *shared_, *slab_;
  int* count_;
};

}  // namespace bromwich::cuda
