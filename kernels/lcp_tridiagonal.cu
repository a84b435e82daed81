// Batched complementarity problems with one tridiagonal matrix: T threads per problem, K consecutive rows per thread. A
// Newton sweep solves, by cyclic reduction (tridiagonal.cuh), the system that equals M on the active set and the
// identity elsewhere, and flips the indices with the wrong sign. A group that has settled goes on to its next problem,
// whose r, v and y are prefetched to shared memory.
//
// Memory traffic: r, v, y read and y written once, 32 bytes per value. Operations: about 30 per value and sweep, plus
// 13 log2 T per thread.

#include "kernels/launch.cuh"
#include "kernels/lcp_in_modes.cuh"
#include "kernels/parts.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace bromwich::cuda {

namespace {

constexpr int most_threads = 256;  ///< per block, for groups no larger than a warp
constexpr Index largest_size = 4096;

template <int T, int K, bool uniform>
__global__ void __launch_bounds__(T > most_threads ? T : most_threads)
    newton(LcpArrays arrays, Coefficients<uniform> M, Problem problem, OutcomeTarget target) {
  using Here = Slot<T, K>;
  constexpr int of_group = 2 * Here::size + Group<T>::scratch;
  extern __shared__ double2 memory[];
  let_next_begin();
  const int g = threadIdx.x / T, t = threadIdx.x % T, groups = blockDim.x / T;
  double* const shared = reinterpret_cast<double*>(memory) + g * of_group;
  Group<T> group(shared + 2 * Here::size, t);
  Outcomes outcomes(target);
  const int n = problem.n, step = gridDim.x * groups;
  const unsigned valid = t * K >= n ? 0 : n - t * K >= K ? (1u << K) - 1 : (1u << (n - t * K)) - 1;

  for (int i = t; i < 2 * Here::size; i += T) shared[i] = 0;  // the padding stays zero
  group.meet();
  await_previous();
  int stage = 0, j = problem.first + blockIdx.x * groups + g;
  if (j < problem.rows) Here(shared).fetch(arrays, n, j, t);
  __pipeline_commit();
  // The first group of a block has the smallest j.
  for (; j - g < problem.rows; j += step, stage = 1 - stage) {
    if (j + step < problem.rows) Here(shared + (1 - stage) * Here::size).fetch(arrays, n, j + step, t);
    __pipeline_commit();
    __pipeline_wait_prior(1);
    group.meet();
    Part<T, K, uniform> part{group, M, Here(shared + stage * Here::size), t, valid, problem.shift, problem.reach};
    const Solution solution = part.solve(problem.cap, problem.least);
    group.meet();
    if (solution.is && j < problem.rows) part.slot.store_y(arrays, n, j, t);
    if (t == 0 && j < problem.rows) solution.count(outcomes, j);
    group.meet();
  }
  outcomes.template finish<(T > 32)>();
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
    my_gap = larger(isfinite(w + y[at + i]) ? fabs(fmin(y[at + i], w)) : nan(""), my_gap);
    my_scale = fmax(my_scale, fabs(q));
  }
  gap[threadIdx.x] = my_gap, scale[threadIdx.x] = my_scale;
  for (int half = 128; half > 0; half /= 2) {
    __syncthreads();
    if (threadIdx.x >= half) continue;
    gap[threadIdx.x] = larger(gap[threadIdx.x], gap[threadIdx.x + half]);
    scale[threadIdx.x] = fmax(scale[threadIdx.x], scale[threadIdx.x + half]);
  }
  if (threadIdx.x == 0) out[blockIdx.x] = gap[0] / scale[0];
}

/// Row i of thread t at [i T + t]; `beyond` past the end.
Memory<double> spread(const Device& device, const Vector& values, int T, int K, double beyond) {
  Vector all(T * K);
  for (int t = 0; t < T; ++t)
    for (int i = 0; i < K; ++i) all[i * T + t] = t * K + i < values.size() ? values[t * K + i] : beyond;
  return on_device(device, all);
}

/// The common value of all rows in the range, if they have one.
std::optional<double> common(const Vector& values, Index from, Index to) {
  for (Index i = from; i < to; ++i)
    if (values[i] != values[from]) return std::nullopt;
  return from < to ? values[from] : 0;
}

std::optional<Coefficients<true>> uniform_coefficients(const Tridiagonal& M, const Equilibration& scale) {
  const Index n = M.diagonal.size();
  const auto lower = common(M.lower, 1, n), diagonal = common(M.diagonal, 0, n), upper = common(M.upper, 0, n - 1),
             row = common(scale.rows, 0, n), column = common(scale.columns, 0, n);
  if (!lower || !diagonal || !upper || !row || !column) return std::nullopt;
  return Coefficients<true>{*lower, *diagonal, *upper, *row, *column};
}

/// Distance in rows at which two unknowns of A x = d, or of any principal subsystem, are decoupled to below rounding: a
/// power of two, at most `all`. With u and w the largest |a| and |c| of rows divided by their diagonal entry, a step of
/// cyclic reduction leaves at most u^2 / (1 - 2 u w) and w^2 / (1 - 2 u w).
Index coupled_rows(const Tridiagonal& A, Index all) {
  double u = 0, w = 0;
  for (Index i = 0; i < A.diagonal.size(); ++i) {
    u = std::max(u, std::abs(A.lower[i] / A.diagonal[i]));
    w = std::max(w, std::abs(A.upper[i] / A.diagonal[i]));
  }
  for (Index rows = 1; rows < all; rows *= 2) {
    if (u + w <= epsilon / 8) return rows;
    const double rest = 1 - 2 * u * w;
    if (!(rest > 0)) return all;
    u = u * u / rest, w = w * w / rest;
  }
  return all;
}

/// Threads per group and rows per thread.
struct Shape {
  int T, K;
};

constexpr Index most_spread = 1024;
constexpr Index few_problems = 2;   ///< per multiprocessor
constexpr Index most_in_modes = 8;  ///< per multiprocessor; for more rows, launch overhead is a small part of a sweep

// Few problems leave most of the device idle, so more threads share each of them.
Shape shape_for(Index n, bool few) {
  if (n <= 32) return {16, 2};
  if (few && n > 128 && n <= most_spread) return {n <= 256 ? 64 : n <= 512 ? 128 : 256, 4};
  Shape shape{32, 2};
  while (shape.T * shape.K < n) (shape.K < 16 ? shape.K : shape.T) *= 2;
  return shape;
}

class TridiagonalLcp final : public LcpBatch {
 public:
  TridiagonalLcp(const Device& device, const Tridiagonal& M, LcpClass lcp_class, double shift, Index rows)
      : LcpBatch(false),
        device_(device),
        n_(M.diagonal.size()),
        shape_(shape_for(n_, rows <= few_problems * device.multiprocessors())),
        shift_(shift),
        shifted_(plus_identity(M, shift)),
        class_(selection_class(shifted_, lcp_class)),
        outcomes_(device, rows, shift),
        residuals_(device, std::size_t(rows)) {
    const Equilibration scale = equilibrate(shifted_);
    Tridiagonal A = scaled(shifted_, scale), given = M;
    const auto uniform = uniform_coefficients(A, scale);
    if (shape_.T == 32 || shape_.K == 4) uniform_ = uniform;
    for (Tridiagonal* t : {&A, &given}) t->lower[0] = t->upper[n_ - 1] = 0;
    coupled_ = coupled_rows(A, shape_.T * shape_.K);
    given_ = given;
    choose_kernel();
    if (uniform && rows <= most_in_modes * device.multiprocessors()) {
      in_modes_ = lcp_in_modes(n_);
      of_modes_ = *uniform;
      if (in_modes_.kernel)
        submit_in_modes = [this](RowTransform& S, const Array& r, const Array& v, bool v_in_modes, Array& y,
                                 Array* y_modes,
                                 Index first) { start_in_modes(S, r, v, v_in_modes, y, y_modes, first); };
    }
    if (uniform_) return;
    lower_ = spread(device, A.lower, shape_.T, shape_.K, 0);
    diagonal_ = spread(device, A.diagonal, shape_.T, shape_.K, 1);
    upper_ = spread(device, A.upper, shape_.T, shape_.K, 0);
    row_scale_ = spread(device, scale.rows, shape_.T, shape_.K, 1);
    column_scale_ = spread(device, scale.columns, shape_.T, shape_.K, 1);
  }

  /// Whether a problem fits into shared memory.
  bool fits() const { return groups_ > 0; }

  // Distributes problems over all multiprocessors before it fills blocks.
  void submit(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    if (first >= y.rows()) return;
    const LcpArrays arrays{values(r), values(v), values(y), int(stride(n_))};
    const Index rows = y.rows();
    const int count = int(rows - first), together = std::max(32 / shape_.T, 1);
    const int even = (count + device_.multiprocessors() - 1) / device_.multiprocessors();
    const int groups = std::clamp((even + together - 1) / together * together, together, groups_);
    const int blocks = std::min((count + groups - 1) / groups, blocks_ * device_.multiprocessors());
    const OutcomeTarget target = outcomes_.target(rows - first, settle_tolerance, settle_tolerance >= 0);
    const Blocks all{unsigned(blocks), unsigned(groups * shape_.T), std::size_t(groups) * bytes_a_group_};
    const char* const what = "starting the complementarity problems";
    if (uniform_)
      follow(device_, uniform_kernel_, all, what, arrays, *uniform_, problem(first, rows, shape_.K), target);
    else
      follow(device_, general_, all, what, arrays,
             {lower_.data(), diagonal_.data(), upper_.data(), row_scale_.data(), column_scale_.data()},
             problem(first, rows, shape_.K), target);
  }
  LcpReport collect() override { return outcomes_.collect(); }
  LcpReport finish(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    return outcomes_.report(r, v, y, first, settle_tolerance, [this]() -> ActiveSetLcp& {
      // Made when first needed: it is dense, and most scenes never use it.
      if (!solver_) solver_.emplace(to_dense(LcpMatrix(shifted_)), class_);
      return *solver_;
    });
  }

  double residual(const Array& r, const Array& v, const Array& y) override {
    if (given_bands_.size() == 0) {  // few plans compute residuals
      RowMatrix bands(3, n_);
      bands << given_.lower.transpose(), given_.diagonal.transpose(), given_.upper.transpose();
      given_bands_ = on_device(device_, bands);
    }
    const double* const lower = given_bands_.data();
    natural_residual<<<unsigned(y.rows()), 256, 0, device_.stream()>>>(values(r), values(v), values(y), lower,
                                                                       lower + n_, lower + 2 * n_, int(n_),
                                                                       int(stride(n_)), residuals_.data());
    check(cudaGetLastError(), "starting the residual");
    return largest(device_, residuals_);
  }

  std::size_t bytes() const override {
    return outcomes_.bytes() + residuals_.bytes() + 5 * lower_.bytes() + 3 * sizeof(double) * std::size_t(n_);
  }

 private:
  void start_in_modes(RowTransform& S, const Array& r, const Array& v, bool v_in_modes, Array& y, Array* y_modes,
                      Index first) {
    const Index rows = y.rows();
    if (first >= rows) return;
    const Modes modes{v_in_modes ? values(v) : nullptr, y_modes ? values(*y_modes) : nullptr, sine_tables(S)};
    const LcpArrays arrays{values(r), v_in_modes ? nullptr : values(v), values(y), int(stride(n_))};
    const OutcomeTarget target = outcomes_.target(rows - first, -1, false);
    follow(device_, in_modes_.kernel, {unsigned(rows - first), unsigned(in_modes_.threads), in_modes_.bytes},
           "starting a sweep in modes", arrays, modes, of_modes_, problem(first, rows, in_modes_.rows), target);
  }

  void choose_kernel() {
    if (shape_.K == 4 && shape_.T == 64) return use<64, 4>();
    if (shape_.K == 4 && shape_.T == 128) return use<128, 4>();
    if (shape_.K == 4 && shape_.T == 256) return use<256, 4>();
    switch (shape_.T * shape_.K) {
      case 32:
        return use<16, 2>();
      case 64:
        return use<32, 2>();
      case 128:
        return use<32, 4>();
      case 256:
        return use<32, 8>();
      case 512:
        return use<32, 16>();
      case 1024:
        return use<64, 16>();
      case 2048:
        return use<128, 16>();
      default:
        return use<256, 16>();
    }
  }

  template <int T, int K>
  void use() {
    bytes_a_group_ = sizeof(double) * std::size_t(2 * Slot<T, K>::size + Group<T>::scratch);
    general_ = newton<T, K, false>;
    if constexpr (T == 32 || K == 4) uniform_kernel_ = newton<T, K, true>;
    const void* const kernel = uniform_ ? (const void*)uniform_kernel_ : (const void*)general_;
    const int all = int(device_.shared_memory());
    groups_ = std::min<int>(T > 32 ? 1 : most_threads / T, all / int(bytes_a_group_));
    groups_ -= groups_ % std::max(32 / T, 1);  // whole warps
    if (groups_ == 0) return;
    check(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, groups_ * int(bytes_a_group_)),
          "reserving shared memory");
    check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&blocks_, kernel, groups_ * T,
                                                        std::size_t(groups_) * bytes_a_group_),
          "asking for the occupancy");
  }

  // K rows per thread.
  Problem problem(Index first, Index rows, int K) const {
    const int reach = int((coupled_ + K - 1) / K);
    return {int(n_), int(first), int(rows), 12 + int(std::min<Index>(n_, 40)), selects_least(class_), shift_, reach};
  }

  const Device& device_;
  Index n_;
  Shape shape_;
  Index coupled_ = 0;    ///< distance up to which rows are coupled
  double shift_;         ///< D
  Tridiagonal shifted_;  ///< M + D I
  LcpClass class_;
  BatchOutcomes outcomes_;
  Memory<double> residuals_;
  Memory<double> lower_, diagonal_, upper_, row_scale_, column_scale_;
  Tridiagonal given_;           ///< M, with 0 outside the matrix
  Memory<double> given_bands_;  ///< on the device
  std::optional<Coefficients<true>> uniform_;
  void (*general_)(LcpArrays, Coefficients<false>, Problem, OutcomeTarget) = nullptr;
  void (*uniform_kernel_)(LcpArrays, Coefficients<true>, Problem, OutcomeTarget) = nullptr;
  LcpInModes in_modes_;
  Coefficients<true> of_modes_{};  ///< matrix of in_modes_
  std::size_t bytes_a_group_ = 0;
  int groups_ = 0;  ///< at most, per block
  int blocks_ = 1;  ///< per multiprocessor
  std::optional<ActiveSetLcp> solver_;
};

}  // namespace

std::unique_ptr<LcpBatch> make_tridiagonal_lcp(const Device& device, const Tridiagonal& M, LcpClass lcp_class,
                                               double shift, Index rows) {
  if (M.diagonal.size() > largest_size) return nullptr;
  auto plan = std::make_unique<TridiagonalLcp>(device, M, lcp_class, shift, rows);
  return plan->fits() ? std::move(plan) : nullptr;
}

}  // namespace bromwich::cuda
