#pragma once
// A tridiagonal system solved by a group of T threads, K consecutive rows in the registers of each: cyclic reduction
// inside the threads until each has one unknown left, its last, then parallel cyclic reduction over the threads, then
// back (Hockney, J. ACM 12, 1965; Wang, ACM Trans. Math. Softw. 7, 1981; Zhang, Cohen, Owens, PPoPP 2010).
//
// A step of reduction eliminates every other row: a row x = d - a x_above - c x_below with the unknowns of its
// neighbours is put into them. All the pivots of a step are independent of each other, so that log2 K + log2 T of them
// follow upon each other instead of n. They are diagonal entries of Schur complements: positive for a P-matrix in any
// order, and for a Z-matrix exactly when it is a nonsingular M-matrix.

#include "kernels/reciprocal.cuh"

namespace bromwich::cuda {

/// A row that has been divided by its pivot: a x_above + x + c x_below = d.
struct Row {
  double a, c, d;
};

/// T threads of a warp that share a system, T <= 32; a warp holds several such groups, which run together.
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
  __device__ void neighbours(const Row& row, int s, Row& up, Row& down) {
    up = {above(row.a, s), above(row.c, s), above(row.d, s)};
    down = {below(row.a, s), below(row.c, s), below(row.d, s)};
  }

  /// Of the group, and of all threads that have to go on together with it.
  __device__ bool any(bool mine) { return (__ballot_sync(all, mine) & mask()) != 0; }
  __device__ bool any_together(bool mine) { return __any_sync(all, mine); }
  /// Of values >= 0, or NaN.
  __device__ double largest(double mine) {
    for (int s = T / 2; s > 0; s /= 2) {
      const double other = __shfl_xor_sync(all, mine, s, T);
      mine = __double_as_longlong(other) > __double_as_longlong(mine) ? other : mine;
    }
    return mine;
  }

 private:
  static constexpr unsigned all = 0xffffffffu;
  __device__ unsigned mask() const { return (T == 32 ? all : (1u << T % 32) - 1) << (threadIdx.x % 32 / T * T); }
  int t_;
};

/// T > 32: the whole block. Values go through two buffers in turn, so that one barrier an exchange is enough.
template <int T>
requires(T > 32) class Group<T> {
 public:
  static constexpr int scratch = 6 * T;
  __device__ Group(double* shared, int t) : shared_(shared), t_(t) {}

  __device__ void meet() { __syncthreads(); }

  __device__ double above(double value) {
    const double* other = publish({value, 0, 0});
    return t_ > 0 ? other[t_ - 1] : 0;
  }
  __device__ double below(double value) {
    const double* other = publish({value, 0, 0});
    return t_ + 1 < T ? other[t_ + 1] : 0;
  }
  __device__ Row below(const Row& row) { return at(publish(row), t_ + 1); }
  __device__ void neighbours(const Row& row, int s, Row& up, Row& down) {
    const double* other = publish(row);
    up = at(other, t_ - s);
    down = at(other, t_ + s);
  }

  __device__ bool any(bool mine) { return __syncthreads_or(mine); }
  __device__ bool any_together(bool mine) { return mine; }
  __device__ double largest(double mine) {
    mine = Group<32>(nullptr, t_ % 32).largest(mine);
    double* other = publish({mine, 0, 0});
    for (int w = 0; w < T; w += 32)
      mine = __double_as_longlong(other[w]) > __double_as_longlong(mine) ? other[w] : mine;
    return mine;
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

/// A pivot counts as positive above 2^-46 of the diagonal entry it came from, by exponents alone, times the square of
/// the `distance` of the rows it now couples: their row sums have lost as much. A doubt costs a look on the host.
__device__ inline bool is_positive(double pivot, double entry, int distance) {
  const double size = fabs(entry) * double(distance) * double(distance);
  return pivot > 0 && __double2hiint(pivot) > __double2hiint(size) - (46 << 20);
}

/// x of rows t K .. t K + K - 1, with a x_above + b x + c x_below = d; b stays as it is. The result is whether all
/// pivots of this thread were positive.
template <int K, int T>
__device__ bool solve_tridiagonal(Group<T>& group, double (&a)[K], const double (&b)[K], double (&c)[K],
                                  double (&d)[K]) {
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
    const Row next = group.below(Row{a[s - 1], c[s - 1], d[s - 1]});
#pragma unroll
    for (int i = 2 * s - 1; i < K; i += 2 * s) {
      const Row up{a[i - s], c[i - s], d[i - s]};
      const Row down = i + s < K ? Row{a[(i + s) % K], c[(i + s) % K], d[(i + s) % K]} : next;
      pivot[i] -= a[i] * up.c + c[i] * down.a;
      d[i] -= a[i] * up.d + c[i] * down.d;
      a[i] *= -up.a;
      c[i] *= -down.c;
    }
  }
  normalise(K - 1, K);
  Row row{a[K - 1], c[K - 1], d[K - 1]};
#pragma unroll
  for (int s = 1; s < T; s *= 2) {
    Row up, down;
    group.neighbours(row, s, up, down);
    const double rest = 1 - (row.a * up.c + row.c * down.a);
    positive = positive && is_positive(rest, 1, s * K);
    const double inverse = reciprocal(rest);
    row = {-row.a * up.a * inverse, -row.c * down.c * inverse, (row.d - (row.a * up.d + row.c * down.d)) * inverse};
  }
  d[K - 1] = row.d;
  const double before = group.above(row.d);
#pragma unroll
  for (int s = K / 2; s >= 1; s /= 2)
#pragma unroll
    for (int i = s - 1; i < K; i += 2 * s)
      d[i] -= a[i] * (i >= s ? d[(i - s + K) % K] : before) + c[i] * d[(i + s) % K];
  return positive;
}

}  // namespace bromwich::cuda
