#pragma once
// A tridiagonal system solved by a group of T threads with K consecutive rows in registers each. Cyclic reduction
// inside the threads leaves one unknown each, the last; parallel cyclic reduction over the threads solves for these;
// then back substitution (Hockney, J. ACM 12, 1965; Wang, ACM Trans. Math. Softw. 7, 1981; Zhang, Cohen, Owens, PPoPP
// 2010).
//
// A reduction step eliminates every other row: x = d - a x_above - c x_below is substituted into the neighbouring rows.
// The pivots of a step are independent, so the critical path has log2 K + log2 T steps instead of n. Pivots are
// diagonal entries of Schur complements: positive for a P-matrix in any order, and for a Z-matrix exactly if it is a
// nonsingular M-matrix.
//
// For diagonally dominant rows the couplings a and c are squared in every step, and fall below rounding after a few
// steps (`reach`).

#include "kernels/reciprocal.cuh"

namespace bromwich::cuda {

/// A row divided by its pivot: a x_above + x + c x_below = d.
struct Row {
  double a, c, d;
};

/// The larger of two values >= 0, or NaN.
__device__ inline double larger_bits(double a, double b) {
  return __double_as_longlong(b) > __double_as_longlong(a) ? b : a;
}

/// T <= 32: threads of a warp that share a system. A warp holds several groups, which run together.
template <int T>
class Group {
 public:
  static constexpr int scratch = 0;  ///< doubles of shared memory
  __device__ Group(double*, int t) : t_(t) {}

  __device__ void meet() { __syncwarp(); }

  __device__ double above(double value, int s = 1) {
    const double other = __shfl_up_sync(all, value, unsigned(s), T);
    return t_ >= s ? other : 0;
  }
  __device__ double below(double value, int s = 1) {
    const double other = __shfl_down_sync(all, value, unsigned(s), T);
    return t_ + s < T ? other : 0;
  }
  __device__ Row below(const Row& row) { return {below(row.a), below(row.c), below(row.d)}; }
  __device__ void around(double value, double& up, double& down) { up = above(value), down = below(value); }
  __device__ void neighbours(const Row& row, int s, Row& up, Row& down) {
    up = {above(row.a, s), above(row.c, s), above(row.d, s)};
    down = {below(row.a, s), below(row.c, s), below(row.d, s)};
  }

  /// Over the group, and over all groups that run together.
  __device__ bool any(bool mine) { return (__ballot_sync(all, mine) & mask()) != 0; }
  __device__ bool any_together(bool mine) { return __any_sync(all, mine); }
  /// Largest of values >= 0, or NaN.
  __device__ double largest(double mine) {
    for (int s = T / 2; s > 0; s /= 2) mine = larger_bits(mine, __shfl_xor_sync(all, mine, s, T));
    return mine;
  }
  __device__ void largest(double& first, double& second) { first = largest(first), second = largest(second); }

 private:
  static constexpr unsigned all = 0xffffffffu;
  __device__ unsigned mask() const { return (T == 32 ? all : (1u << T % 32) - 1) << (threadIdx.x % 32 / T * T); }
  int t_;
};

/// T > 32: the whole block. Values alternate between two buffers, so one barrier per exchange is enough.
template <int T>
requires(T > 32) class Group<T> {
 public:
  static constexpr int scratch = 6 * T;
  __device__ Group(double* shared, int t) : shared_(shared), t_(t) {}

  __device__ void meet() { __syncthreads(); }

  __device__ Row below(const Row& row) { return at(publish(row), t_ + 1); }
  __device__ void around(double value, double& up, double& down) {
    const double* other = publish({value, 0, 0});
    up = t_ > 0 ? other[t_ - 1] : 0;
    down = t_ + 1 < T ? other[t_ + 1] : 0;
  }
  __device__ void neighbours(const Row& row, int s, Row& up, Row& down) {
    const double* other = publish(row);
    up = at(other, t_ - s);
    down = at(other, t_ + s);
  }

  __device__ bool any(bool mine) { return __syncthreads_or(mine); }
  __device__ bool any_together(bool mine) { return mine; }
  __device__ double largest(double mine) {
    double unused = 0;
    largest(mine, unused);
    return mine;
  }
  __device__ void largest(double& first, double& second) {
    Group<32>(nullptr, t_ % 32).largest(first, second);
    const double* other = publish({first, second, 0});
    for (int w = 0; w < T; w += 32) {
      first = larger_bits(first, other[w]);
      second = larger_bits(second, other[T + w]);
    }
  }

 private:
  __device__ double* publish(const Row& row) {
    double* const buffer = shared_ + turn_ * 3 * T;
    turn_ = 1 - turn_;
    buffer[t_] = row.a;
    buffer[T + t_] = row.c;
    buffer[2 * T + t_] = row.d;
    __syncthreads();
    return buffer;
  }
  __device__ static Row at(const double* buffer, int t) {
    if (t < 0 || t >= T) return {0, 0, 0};
    return {buffer[t], buffer[T + t], buffer[2 * T + t]};
  }

  double* shared_;
  int t_, turn_ = 0;
};

/// A pivot counts as positive if it exceeds 2^-46, by exponents alone, of the diagonal entry it came from times the
/// square of the `distance` of the rows it now couples, which bounds the loss of their row sums. Doubtful problems go
/// to the host.
__device__ inline bool is_positive(double pivot, double entry, int distance) {
  const double size = fabs(entry) * double(distance) * double(distance);
  return pivot > 0 && __double2hiint(pivot) > __double2hiint(size) - (46 << 20);
}

/// Solves a x_above + b x + c x_below = d for x of rows t K .. t K + K - 1. b is kept; `above` and `below` become x of
/// the rows before and after. Rows whose unknowns are `reach` K or more apart count as decoupled. Returns whether all
/// pivots of this thread were positive.
template <int K, int T>
__device__ bool solve_tridiagonal(Group<T>& group, int reach, double (&a)[K], const double (&b)[K], double (&c)[K],
                                  double (&d)[K], double& above, double& below) {
  bool positive = true;
  double pivot[K];
#pragma unroll
  for (int i = 0; i < K; ++i) pivot[i] = b[i];
  const auto normalise = [&](int i, int distance) {
    positive = positive && is_positive(pivot[i], b[i], distance);
    const double inverse = reciprocal(pivot[i]);
    a[i] *= inverse, c[i] *= inverse, d[i] *= inverse;
  };
#pragma unroll
  for (int s = 1; s < K; s *= 2) {
#pragma unroll
    for (int i = s - 1; i < K; i += 2 * s) normalise(i, s);
#pragma unroll
    for (int i = 2 * s - 1; i < K; i += 2 * s) {
      pivot[i] -= a[i] * c[i - s];
      d[i] -= a[i] * d[i - s];
      a[i] *= -a[i - s];
      if (i + s >= K) continue;
      pivot[i] -= c[i] * a[(i + s) % K];
      d[i] -= c[i] * d[(i + s) % K];
      c[i] *= -c[(i + s) % K];
    }
  }
  // The first row in terms of the last unknowns of the previous thread and of this one; the previous thread needs it.
  Row first{a[0], c[0], d[0]};
#pragma unroll
  for (int s = 2; s < K; s *= 2)
    first = {first.a - first.c * a[s - 1], -first.c * c[s - 1], first.d - first.c * d[s - 1]};
  const Row next = group.below(first);
  pivot[K - 1] -= c[K - 1] * next.a;
  d[K - 1] -= c[K - 1] * next.d;
  c[K - 1] *= -next.c;
  normalise(K - 1, K);
  Row row{a[K - 1], c[K - 1], d[K - 1]};
#pragma unroll
  for (int s = 1; s < T; s *= 2) {
    if (s >= reach) break;  // uniform over the threads
    Row up, down;
    group.neighbours(row, s, up, down);
    const double rest = 1 - (row.a * up.c + row.c * down.a);
    positive = positive && is_positive(rest, 1, s * K);
    const double inverse = reciprocal(rest);
    row = {-row.a * up.a * inverse, -row.c * down.c * inverse, (row.d - (row.a * up.d + row.c * down.d)) * inverse};
  }
  d[K - 1] = row.d;
  double last_below;
  group.around(row.d, above, last_below);
  below = next.d - next.a * row.d - next.c * last_below;
#pragma unroll
  for (int s = K / 2; s >= 1; s /= 2)
#pragma unroll
    for (int i = s - 1; i < K; i += 2 * s) d[i] -= a[i] * (i >= s ? d[(i - s + K) % K] : above) + c[i] * d[(i + s) % K];
  return positive;
}

}  // namespace bromwich::cuda
