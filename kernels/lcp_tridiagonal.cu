// Batched complementarity problems with one tridiagonal matrix: a group of T threads per problem, K consecutive rows a
// thread, everything of a problem in registers and shared memory from the first sweep to the last.
//
// A Newton sweep solves the system that equals M on the active set and the identity elsewhere. Each thread eliminates
// inside its rows, so that x_i = f_i - l_i x_left - r_i x_last with the last unknowns of its left neighbour and its own
// (Wang's partition method, ACM Trans. Math. Softw. 7, 1981); the T last unknowns form a tridiagonal system again,
// which parallel cyclic reduction solves in log2 T steps. Eliminating in any order keeps the diagonal positive for a
// P-matrix, and for a Z-matrix exactly when the active block is an M-matrix. Problems that have settled leave.
//
// Memory: r, v, y read once and y written once, 32 bytes a value. Operations: about 35 multiply-adds a value and sweep,
// a reciprocal counted as 8.

#include "kernels/lcp_batch.hpp"
#include "kernels/parts.hpp"

#include "core/error.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

namespace bromwich::cuda {

namespace {

constexpr int K = 8;           ///< rows a thread
constexpr int resident = 512;  ///< threads a multiprocessor: 128 registers each

/// R M C and the scales, row i of thread t at [i T + t]; beyond n the identity.
struct Coefficients {
  const double *lower, *diagonal, *upper, *row_scale, *column_scale;
};

struct Arrays {
  const double *r, *v;
  double* y;
  int stride;  ///< from row to row
};

template <int T>
__device__ void meet() {
  if constexpr (T <= 32)
    __syncwarp();
  else
    __syncthreads();
}

// Of all threads of a group (a block, or a whole warp where several groups share one).
template <int T>
__device__ bool any_of(bool mine) {
  if constexpr (T <= 32)
    return __any_sync(0xffffffffu, mine);
  else
    return __syncthreads_or(mine);
}

/// Values that a group passes around: f of the last unknowns in two buffers, and scratch for reductions.
template <int T>
struct Exchange {
  double a[2][T], c[2][T], d[2][T];

  __device__ double largest(double mine, int t) {
    meet<T>();
    a[0][t] = mine;
    meet<T>();
    for (int half = T / 2; half > 0; half /= 2) {
      if (t < half) a[0][t] = fmax(a[0][t], a[0][t + half]);
      meet<T>();
    }
    return a[0][0];
  }
};

// Column i of a problem in shared memory, one gap after each thread's rows: no two threads meet in a bank.
__device__ int padded(int i) { return i + i / K; }

template <int T, int groups>
struct Shared {
  Exchange<T> exchange[groups];
  double row[groups][T * K + T];
};

template <int T>
struct Problem {
  double q[K], x[K];
  unsigned active = 0;
  bool positive = true;
  int t;
  Exchange<T>& e;
  const Coefficients& M;

  __device__ double lower(int i) const { return M.lower[i * T + t]; }
  __device__ double diagonal(int i) const { return M.diagonal[i * T + t]; }
  __device__ double upper(int i) const { return M.upper[i * T + t]; }
  __device__ bool is_active(int i) const { return active >> i & 1; }

  __device__ double reciprocal(double pivot, double size) {
    positive = positive && pivot > 64 * epsilon * size;
    return 1 / pivot;
  }

  // x for the current active set.
  __device__ void substitute() {
    double l[K], right[K], inverse[K];
    positive = true;
    double above = 0;  // the upper entry of the row before
#pragma unroll
    for (int i = 0; i < K; ++i) {
      const bool on = is_active(i);
      const double a = on ? lower(i) : 0, size = on ? diagonal(i) : 1;
      double b = size;
      x[i] = on ? -q[i] : 0;
      l[i] = a;
      if (i > 0) {
        const double w = a * inverse[i - 1];
        b -= w * above;
        x[i] -= w * x[i - 1];
        l[i] = -w * l[i - 1];
      }
      inverse[i] = i < K - 1 ? reciprocal(b, size) : b;  // of the last row: the pivot itself, not complete yet
      above = on ? upper(i) : 0;
      right[i] = above;
    }
#pragma unroll
    for (int i = K - 3; i >= 0; --i) {
      const double w = right[i] * inverse[i + 1];
      x[i] -= w * x[i + 1];
      l[i] -= w * l[i + 1];
      right[i] = -w * right[i + 1];
    }
    reduce(l[K - 1], inverse[K - 1], right[K - 1], x[K - 1], l[0] * inverse[0], right[0] * inverse[0],
           x[0] * inverse[0]);
    const double left = t > 0 ? e.d[0][t - 1] : 0;
    x[K - 1] = e.d[0][t];
#pragma unroll
    for (int i = 0; i < K - 1; ++i) x[i] = (x[i] - l[i] * left - right[i] * x[K - 1]) * inverse[i];
  }

  // The system of the last unknowns, a x_left + b x + c x_first(next) = d; the first unknown of this thread is
  // f - fl x_left - fr x. Leaves the unknowns in e.d[0].
  __device__ void reduce(double a, double b, double c, double d, double fl, double fr, double f) {
    meet<T>();
    e.a[1][t] = fl, e.c[1][t] = fr, e.d[1][t] = f;
    meet<T>();
    if (t + 1 < T) {
      b -= c * e.a[1][t + 1];
      d -= c * e.d[1][t + 1];
      c = -c * e.c[1][t + 1];
    } else {
      c = 0;
    }
    double inverse = reciprocal(b, is_active(K - 1) ? diagonal(K - 1) : 1);
    a *= inverse, c *= inverse, d *= inverse;
    int from = 0;
    e.a[0][t] = a, e.c[0][t] = c, e.d[0][t] = d;
    meet<T>();
    for (int s = 1; s < T; s *= 2, from = 1 - from) {
      double b2 = 1, a2 = 0, c2 = 0, d2 = d;
      if (t >= s) {
        b2 -= a * e.c[from][t - s];
        d2 -= a * e.d[from][t - s];
        a2 = -a * e.a[from][t - s];
      }
      if (t + s < T) {
        b2 -= c * e.a[from][t + s];
        d2 -= c * e.d[from][t + s];
        c2 = -c * e.c[from][t + s];
      }
      inverse = reciprocal(b2, 1);
      a = a2 * inverse, c = c2 * inverse, d = d2 * inverse;
      e.a[1 - from][t] = a, e.c[1 - from][t] = c, e.d[1 - from][t] = d;
      meet<T>();
    }
    e.d[0][t] = d;
    meet<T>();
  }

  // Exchanges what has the wrong sign; whether this thread had any.
  __device__ bool exchange(double tolerance) {
    const double left = t > 0 ? e.d[0][t - 1] : 0;
    e.a[1][t] = x[0];
    meet<T>();
    const double right = t + 1 < T ? e.a[1][t + 1] : 0;
    unsigned flips = 0;
#pragma unroll
    for (int i = 0; i < K; ++i) {
      const double w =
          q[i] + lower(i) * (i > 0 ? x[i - 1] : left) + diagonal(i) * x[i] + upper(i) * (i + 1 < K ? x[i + 1] : right);
      if ((is_active(i) ? x[i] : w) < -tolerance) flips |= 1u << i;
    }
    active ^= flips;
    return flips != 0;
  }
};

template <int T, int groups>
__global__ void __launch_bounds__(T* groups, (resident + T * groups - 1) / (T * groups))
    newton(Arrays arrays, Coefficients M, int n, int first, int rows, int cap, bool least, RowOutcome* outcomes) {
  extern __shared__ unsigned char bytes[];
  auto& shared = *reinterpret_cast<Shared<T, groups>*>(bytes);
  const int g = threadIdx.x / T, t = threadIdx.x % T, j = first + blockIdx.x * groups + g;
  const bool given = j < rows;
  const long at = long(j) * arrays.stride;
  double* row = shared.row[g];
  Problem<T> p{.t = t, .e = shared.exchange[g], .M = M};

  for (int i = t; i < n; i += T) row[padded(i)] = given ? arrays.r[at + i] + arrays.v[at + i] : 1;
  meet<T>();
  double size = 0;
#pragma unroll
  for (int i = 0; i < K; ++i) {
    p.q[i] = t * K + i < n ? M.row_scale[i * T + t] * row[padded(t * K + i)] : 1;
    size = fmax(size, fabs(t * K + i < n ? p.q[i] : 0));
  }
  meet<T>();
  for (int i = t; i < n; i += T) row[padded(i)] = given ? arrays.y[at + i] : 0;
  meet<T>();
  double old[K];
#pragma unroll
  for (int i = 0; i < K; ++i) {
    old[i] = t * K + i < n ? row[padded(t * K + i)] : 0;
    if (old[i] > 0) p.active |= 1u << i;
  }
  // Rounding of M y + q: a handful of operations of the size of q for a well-scaled M.
  const double tolerance = 16 * epsilon * p.e.largest(size, t);

  bool settled = false;
  int sweeps = 0;
  for (int count = 1; count <= cap; ++count) {
    if (!settled) sweeps = count;
    p.substitute();
    const bool flipped = p.exchange(tolerance);
    bool others = flipped;
    if constexpr (T < 32) {  // of this group alone
      const unsigned mask = (T == 32 ? 0xffffffffu : ((1u << T) - 1) << (threadIdx.x % 32 / T * T));
      others = (__ballot_sync(0xffffffffu, flipped) & mask) != 0;
    } else {
      others = any_of<T>(flipped);
    }
    settled = !others;
    if (!any_of<T>(!settled)) break;
  }

  double change = 0, magnitude = 0, sum = 0;
#pragma unroll
  for (int i = 0; i < K; ++i) {
    const double y = M.column_scale[i * T + t] * fmax(p.x[i], 0.0);
    change = fmax(change, fabs(y - old[i]));
    magnitude = fmax(magnitude, y);
    sum += fabs(p.q[i]) + fabs(p.x[i]);
    p.x[i] = y;
  }
  change = p.e.largest(change, t);
  magnitude = p.e.largest(magnitude, t);
  const bool finite = p.e.largest(isfinite(sum) ? 0 : 1, t) == 0;
  // For a Z-matrix the solution is the least one exactly when the active block has positive pivots.
  const bool positive = p.e.largest(p.positive ? 0 : 1, t) == 0;
  const bool solved = finite && settled && (!least || positive);
  if (solved) {
#pragma unroll
    for (int i = 0; i < K; ++i)
      if (t * K + i < n) row[padded(t * K + i)] = p.x[i];
  }
  meet<T>();
  if (!given) return;
  if (solved)
    for (int i = t; i < n; i += T) arrays.y[at + i] = row[padded(i)];
  if (t == 0) outcomes[j] = {finite ? change : nan(""), magnitude, solved ? sweeps : -sweeps};
}

__global__ void natural_residual(const double* r, const double* v, const double* y, const double* lower,
                                 const double* diagonal, const double* upper, int n, int stride, double* out) {
  __shared__ double gap[256], scale[256];
  const long at = long(blockIdx.x) * stride;
  double my_gap = 0, my_scale = 1;
  for (int i = threadIdx.x; i < n; i += blockDim.x) {
    const double q = r[at + i] + v[at + i];
    double w = q + diagonal[i] * y[at + i];
    if (i > 0) w += lower[i] * y[at + i - 1];
    if (i + 1 < n) w += upper[i] * y[at + i + 1];
    const double natural = fabs(fmin(y[at + i], w));
    my_gap = isfinite(w + y[at + i]) ? fmax(my_gap, natural) : INFINITY;
    my_scale = fmax(my_scale, fabs(q));
  }
  gap[threadIdx.x] = my_gap, scale[threadIdx.x] = my_scale;
  for (int half = 128; half > 0; half /= 2) {
    __syncthreads();
    if (threadIdx.x >= half) continue;
    gap[threadIdx.x] = fmax(gap[threadIdx.x], gap[threadIdx.x + half]);
    scale[threadIdx.x] = fmax(scale[threadIdx.x], scale[threadIdx.x + half]);
  }
  if (threadIdx.x == 0) out[blockIdx.x] = isinf(gap[0]) ? nan("") : gap[0] / scale[0];
}

/// Host vector of length n as row i of thread t at [i T + t], `beyond` past the end.
Memory<double> spread(const Device& device, const Vector& values, int T, double beyond) {
  Vector all(T * K);
  for (int t = 0; t < T; ++t)
#pragma unroll
    for (int i = 0; i < K; ++i) all[i * T + t] = t * K + i < values.size() ? values[t * K + i] : beyond;
  return on_device(device, all);
}

class TridiagonalLcp final : public LcpBatch {
 public:
  TridiagonalLcp(const Device& device, const Tridiagonal& M, LcpClass lcp_class, Index rows)
      : device_(device),
        n_(M.diagonal.size()),
        class_(selection_class(M, lcp_class)),
        outcomes_(device, rows),
        residuals_(device, std::size_t(rows)),
        original_(M) {
    while (T_ * K < n_) T_ *= 2;
    if (T_ > 1024)
      throw Error("M", "is tridiagonal of size " + std::to_string(n_),
                  "use the cpu backend above " + std::to_string(1024 * K));
    const Equilibration scale = equilibrate(M);
    Tridiagonal A = std::get<Tridiagonal>(scaled(M, scale)), given = M;
    for (Tridiagonal* t : {&A, &given}) t->lower[0] = t->upper[n_ - 1] = 0;
    lower_ = spread(device, A.lower, T_, 0);
    diagonal_ = spread(device, A.diagonal, T_, 1);
    upper_ = spread(device, A.upper, T_, 0);
    row_scale_ = spread(device, scale.rows, T_, 1);
    column_scale_ = spread(device, scale.columns, T_, 1);
    given_lower_ = on_device(device, given.lower);
    given_diagonal_ = on_device(device, given.diagonal);
    given_upper_ = on_device(device, given.upper);
  }

  LcpReport solve(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    const Arrays arrays{values(r), values(v), values(y), int(stride(n_))};
    switch (T_) {
      case 4:
        launch<4, 32>(arrays, first, y.rows());
        break;
      case 8:
        launch<8, 16>(arrays, first, y.rows());
        break;
      case 16:
        launch<16, 8>(arrays, first, y.rows());
        break;
      case 32:
        launch<32, 4>(arrays, first, y.rows());
        break;
      case 64:
        launch<64, 1>(arrays, first, y.rows());
        break;
      case 128:
        launch<128, 1>(arrays, first, y.rows());
        break;
      case 256:
        launch<256, 1>(arrays, first, y.rows());
        break;
      case 512:
        launch<512, 1>(arrays, first, y.rows());
        break;
      default:
        launch<1024, 1>(arrays, first, y.rows());
        break;
    }
    return outcomes_.report(r, v, y, first, settle_tolerance, [this]() -> ActiveSetLcp& {
      // Made when first needed: it is dense, and most scenes never get here.
      if (!solver_) solver_.emplace(to_dense(LcpMatrix(original_)), class_);
      return *solver_;
    });
  }

  double residual(const Array& r, const Array& v, const Array& y) override {
    natural_residual<<<unsigned(y.rows()), 256, 0, device_.stream()>>>(
        values(r), values(v), values(y), given_lower_.data(), given_diagonal_.data(), given_upper_.data(), int(n_),
        int(stride(n_)), residuals_.data());
    check(cudaGetLastError(), "starting the residual");
    return largest(device_, residuals_);
  }

  std::size_t bytes() const override { return outcomes_.bytes() + residuals_.bytes() + 8 * lower_.bytes(); }

 private:
  template <int T, int groups>
  void launch(const Arrays& arrays, Index first, Index rows) {
    if (first >= rows) return;
    constexpr int bytes = int(sizeof(Shared<T, groups>));
    if constexpr (bytes > 48 * 1024)
      check(cudaFuncSetAttribute(newton<T, groups>, cudaFuncAttributeMaxDynamicSharedMemorySize, bytes),
            "reserving shared memory");
    const Coefficients M{lower_.data(), diagonal_.data(), upper_.data(), row_scale_.data(), column_scale_.data()};
    const int cap = 12 + int(std::min<Index>(n_, 40)), blocks = int((rows - first + groups - 1) / groups);
    newton<T, groups><<<blocks, T * groups, bytes, device_.stream()>>>(arrays, M, int(n_), int(first), int(rows), cap,
                                                                       class_ == LcpClass::Z, outcomes_.data());
    check(cudaGetLastError(), "starting the complementarity problems");
  }

  const Device& device_;
  Index n_;
  int T_ = 4;
  LcpClass class_;
  RowOutcomes outcomes_;
  Memory<double> residuals_;
  Memory<double> lower_, diagonal_, upper_, row_scale_, column_scale_;
  Memory<double> given_lower_, given_diagonal_, given_upper_;
  Tridiagonal original_;
  std::optional<ActiveSetLcp> solver_;
};

}  // namespace

std::unique_ptr<LcpBatch> make_tridiagonal_lcp(const Device& device, const Tridiagonal& M, LcpClass lcp_class,
                                               Index rows) {
  return std::make_unique<TridiagonalLcp>(device, M, lcp_class, rows);
}

}  // namespace bromwich::cuda
