// Steps of a modal march by one cooperative launch. Block b owns the rows i and the modes l of `own` neighbouring
// indices.
//
// symbol  meaning
// free_j  v_j without W_0 y_j, in modes; q_j = r_j + S free_j
// G(S)    the tableau of a step after principal pivots on the active set S (kernels/march_transform.cuh): for a known S
//         one product of G with r_j and free_j gives both y_j and its modes u
//
// With u, free_{j+1} = W_1 u + Σ_k C_k E_k z_k follows at once. It is sent before it is known whether S is right: a
// message holds free_{j+1} of one mode and whether the row with the same index has the wrong sign. If no row has, the
// step is done after one message exchange between blocks. Otherwise all blocks pivot on the wrong indices and repeat
// the step. The rows of G needed for the pivots are sent along, so a Newton sweep costs one message exchange too.

#include "kernels/march_steps.hpp"

#include "kernels/march_transform.cuh"

#include <algorithm>
#include <cfloat>

namespace bromwich::cuda {

namespace {

constexpr int most_threads = 512;

// Sums `count` values over the warp by recursive halving: lane t gets the sum of value t * count / 32. The recursion
// makes every index a constant, so the values stay in registers.
template <int count, int bit = 16, int size>
__device__ double scattered_sum(double (&value)[size]) {
  if constexpr (count > 1) {
    constexpr int half = count / 2;
    const bool upper = (threadIdx.x & bit) != 0;
#pragma unroll
    for (int i = 0; i < half; ++i) {
      const double other = upper ? value[i] : value[i + half];
      value[i] = (upper ? value[i + half] : value[i]) + __shfl_xor_sync(~0u, other, bit);
    }
    return scattered_sum<half, bit / 2>(value);
  } else {
#pragma unroll
    for (int left = bit; left > 0; left /= 2) value[0] += __shfl_xor_sync(~0u, value[0], left);
    return value[0];
  }
}

__global__ void form_transform(StepTables m, int own, double* G) {
  form_rows(m, own, blockIdx.x * own, G + long(blockIdx.x) * 4 * own * m.n);
}

/// One thread's part of a march. The first `own` lanes of the first warp finish one row and one mode each.
template <int own, int columns, bool resident>
struct Marcher {
  Transform<own, columns, resident> g;
  const StepTables& m;
  const StepState& s;
  const StepArrays& a;
  const int n, K, thread, threads, begin;

  // Values of the thread's columns; `ahead` is prefetched for the following step.
  double free[columns] = {}, next[columns] = {}, scale[columns] = {}, r[columns] = {}, r_ahead[columns] = {};
  // Values of the lane's own row and mode.
  const bool finishes;
  double own_free = 0, own_next = 0, value = 0, u = 0;
  double own_scale = 0, own_column_scale = 0, lag1 = 0, w0 = 0;
  double own_r = 0, own_r_ahead = 0, drive = 0, drive_next = 0, drive_ahead = 0;

  __device__ Marcher(const StepTables& m, const StepState& s, const StepArrays& a, double* memory)
      : g(m, s, memory),
        m(m),
        s(s),
        a(a),
        n(g.n),
        K(m.exponentials),
        thread(g.thread),
        threads(g.threads),
        begin(g.begin),
        finishes(thread < own && begin + thread < n) {}

  // Loads tables and the state at row `first`. In shared memory every thread reads back only its own values.
  __device__ void load(int first) {
    for (int k = thread; k < K; k += threads)
      for (int i = 0; i < own; ++i) {
        const bool given = begin + i < n;
        const int at = given ? k * n + begin + i : 0;
        g.shared.decay[i * K + k] = given ? m.decay[at] : 0;
        g.shared.weight[i * K + k] = given ? m.output[at] * m.decay[at] : 0;
        g.shared.z[i * K + k] = given ? s.z[at] : 0;
      }
    for (int q = 0; q < columns; ++q) {
      const int c = thread + q * threads;
      if (c >= n) continue;
      free[q] = s.known[c];
      scale[q] = m.row_scale[c];
    }
    if (finishes) {
      const int l = begin + thread;
      own_free = s.known[l];
      own_scale = m.row_scale[l], own_column_scale = m.column_scale[l];
      lag1 = m.lag1[l], w0 = m.w0[l];
      if (a.drive) {
        drive_next = a.drive[long(first) * a.step + l];
        drive_ahead = a.drive[long(min(first + 1, a.rows - 1)) * a.step + l];
      }
    }
    read_ahead(first);
    advance_inputs(first);
  }

  __device__ void read_ahead(int j) {
    const double* row = a.r + long(min(j, a.rows - 1)) * a.step;
#pragma unroll
    for (int q = 0; q < columns; ++q) {
      const int c = thread + q * threads;
      if (c < n) r_ahead[q] = row[c];
    }
    if (finishes) own_r_ahead = row[begin + thread];
  }

  // Makes the prefetched r and drive of row j current and prefetches the next.
  __device__ void advance_inputs(int j) {
#pragma unroll
    for (int q = 0; q < columns; ++q) r[q] = r_ahead[q];
    own_r = own_r_ahead;
    read_ahead(j + 1);
    drive = drive_next, drive_next = drive_ahead;
    if (finishes && a.drive) drive_ahead = a.drive[long(min(j + 2, a.rows - 1)) * a.step + begin + thread];
  }

  // Starts from the start set of the previous run. Returns the number of indices in which it differs from {y_0 > 0}.
  __device__ int start() {
    g.updates = *s.start_updates;
    g.copy(g.P, g.kept(s.start_transform));
    for (int q = 0; q < columns; ++q) {
      const int c = thread + q * threads;
      const bool given = c < n, was_active = given && s.start_active[c];
      if (given) g.shared.active[c] = was_active;
      g.mark(q, given && (a.y[c] > 0) != was_active);
    }
    return g.compact();
  }

  // Stores G for the start set. All blocks have read the old one, since they have sent messages since.
  __device__ void keep_start() const {
    g.copy(g.kept(s.start_transform), g.P);
    if (blockIdx.x > 0) return;
    for (int c = thread; c < n; c += threads) s.start_active[c] = g.shared.active[c];
    if (thread == 0) *s.start_updates = g.updates;
  }

  // Starts step j from the set that it had in the last run; false if there was none, and the step before goes on.
  __device__ bool take_kept(int j) {
    if (j > 1 && s.start_updates[j - 1] == 0) return false;
    __syncthreads();  // the step before has been accepted by all threads
    g.copy(g.P, g.kept(s.start_transform + (j - 1) * s.transform_size));
    for (int c = thread; c < n; c += threads) g.shared.active[c] = s.start_active[(j - 1) * n + c];
    g.updates = s.start_updates[j - 1];
    __syncthreads();
    return true;
  }

  // All blocks have read the old values, since they have sent messages since.
  __device__ void keep(int j) const {
    g.copy(g.kept(s.start_transform + (j - 1) * s.transform_size), g.P);
    if (blockIdx.x > 0) return;
    for (int c = thread; c < n; c += threads) s.start_active[(j - 1) * n + c] = g.shared.active[c];
    if (thread == 0) s.start_updates[j - 1] = g.updates;
  }

  __device__ void resume() {
    if (resident) g.copy(g.P, g.kept(s.transform));
    for (int c = thread; c < n; c += threads) g.shared.active[c] = s.active[c];
    g.updates = *s.updates;
    __syncthreads();
  }

  __device__ void save() const {
    if (resident) g.copy(g.kept(s.transform), g.P);
    for (int k = thread; k < K; k += threads)
      for (int i = 0; i < own && begin + i < n; ++i) s.z[k * n + begin + i] = g.shared.z[i * K + k];
    if (finishes) s.known[begin + thread] = own_free;
    if (blockIdx.x > 0) return;
    for (int c = thread; c < n; c += threads) s.active[c] = g.shared.active[c];
    if (thread == 0) *s.updates = g.updates;
  }

  // next <- the messages of all blocks. Marks rows with the wrong sign; returns whether there are any, or a value is
  // not finite (`broken`). Ends with a barrier.
  __device__ bool receive_all(bool& broken) {
    bool any = false, infinite = false;
#pragma unroll
    for (int q = 0; q < columns; ++q) {
      const int c = thread + q * threads;
      bool wrong = false;
      if (c < n) next[q] = receive(g.mail(g.number, c), g.number, wrong);
      g.mark(q, wrong);
      any |= wrong;
      infinite |= isinf(next[q]);
    }
    if (any) __threadfence();  // orders the reads of the rows of G sent along
    if (!__syncthreads_or(any || infinite)) return false;
    broken = __syncthreads_or(infinite);
    return true;
  }

  // [left right] (-(R r)_S, free) of the own rows; for P and T also the sum of absolute terms.
  template <bool with_terms>
  __device__ void multiply(const double* left, const double* right, double (&sum)[2 * own]) const {
#pragma unroll
    for (int q = 0; q < columns; ++q) {
      const int c = thread + q * threads;
      if (c >= n) continue;
      const double x = -scale[q] * r[q];
      const bool in_set = g.shared.active[c];
#pragma unroll
      for (int i = 0; i < own; ++i) {
        const double a = in_set ? left[i * n + c] * x : 0, b = right[i * n + c] * free[q];
        sum[i] += a + b;
        if (with_terms) sum[own + i] += fabs(a) + fabs(b);
      }
    }
  }

  __device__ void store_partial(int part, double (&sum)[2 * own]) const {
    const int lane = thread % 32, of_lane = lane * own / 16;
    const double mine = scattered_sum<2 * own>(sum);
    if (lane % (16 / own) == 0) g.shared.partial[(thread / 32 * 2 + part) * 2 * own + of_lane] = mine;
  }

  // (y^_S, w^_I), the sums of their absolute terms, u and Σ_k C_k E_k z_k of the own indices. Lane i of the first warp
  // gets value i.
  __device__ double products() const {
    double rows[2 * own] = {}, modes[2 * own] = {};
    multiply<true>(g.P, g.T, rows);
    store_partial(0, rows);
    multiply<false>(g.V, g.U, modes);
    for (int k = thread; k < K; k += threads)
#pragma unroll
      for (int i = 0; i < own; ++i) modes[own + i] += g.shared.weight[i * K + k] * g.shared.z[i * K + k];
    store_partial(1, modes);
    __syncthreads();
    if (thread >= 32) return 0;
    double total = 0;
    for (int w = thread / (4 * own); w < threads / 32; w += 8 / own)
      total += g.shared.partial[w * 4 * own + thread % (4 * own)];
    if (own == 4) total += __shfl_xor_sync(~0u, total, 16);
    return total;
  }

  // First warp: computes value, u and free_{j+1} of the lane's own index and sends them.
  __device__ void finish(double total) {
    const int i = thread % own, l = finishes ? begin + thread : 0;
    value = __shfl_sync(~0u, total, i);
    double terms = __shfl_sync(~0u, total, own + i);
    u = __shfl_sync(~0u, total, 2 * own + i);
    const double past = __shfl_sync(~0u, total, 3 * own + i);
    bool wrong_sign = false;
    if (finishes) {
      if (!g.shared.active[l]) {
        value += own_scale * own_r;
        terms += fabs(own_scale * own_r);
      }
      own_next = lag1 * (u + drive) + past + w0 * drive_next;
      own_next = to_send(own_next, fabs(value) + fabs(own_next) <= DBL_MAX);
      g.shared.input[thread] = u + drive;
      wrong_sign = value < -16 * DBL_EPSILON * terms;
    }
    const unsigned rows = __ballot_sync(~0u, wrong_sign);
    if (rows) g.publish(rows, g.number);
    if (finishes) send(g.mail(g.number, l), own_next, g.number, wrong_sign);
  }

  // Accepts row j: z <- E z + u, free <- next.
  __device__ void commit(int j) {
    if (finishes) {
      const int l = begin + thread;
      const long at = long(j) * a.step + l;
      a.y[at] = g.shared.active[l] ? own_column_scale * fmax(value, 0.0) : 0;
      a.input[at] = u;
      a.known[at] = own_free;
      own_free = own_next;
    }
    for (int k = thread; k < K; k += threads)
#pragma unroll
      for (int i = 0; i < own; ++i)
        g.shared.z[i * K + k] = g.shared.decay[i * K + k] * g.shared.z[i * K + k] + g.shared.input[i];
#pragma unroll
    for (int q = 0; q < columns; ++q) free[q] = next[q];
  }

  // Newton sweeps pivot on all wrong signs. If they do not end, only the first one is pivoted on, which terminates.
  __device__ StepOutcome march(const StepSpan& span) {
    StepOutcome out{0, span.first, 0, 0};
    const int cap = 12 + min(n, 40);
    int sweeps = 0, count = 0;
    const bool keeps = s.kept_steps > 0;
    if (span.begins && !keeps)
      count = start();
    else if (!keeps)
      resume();
    bool starting = true, fresh = keeps, pivoted = false;  // since the tableau was kept
    for (int j = span.first; j < span.last;) {
      if (fresh) pivoted = !take_kept(j);
      fresh = false;
      if (count > 0) {
        if (!g.exchange_or_form(count, !starting)) break;
        if (starting) keep_start();
        pivoted = true;
      }
      starting = false;
      ++out.sweeps, ++sweeps, ++g.number;
      const double total = products();
      if (thread < 32) finish(total);
      bool broken = false;
      if (!receive_all(broken)) {
        commit(j);
        if (keeps && pivoted) keep(j);
        advance_inputs(++j);
        out.reached = j;
        sweeps = count = 0;
        fresh = keeps;
        continue;
      }
      if (broken || sweeps > cap + 10 * n) break;
      count = g.compact();
      if (sweeps == cap) ++out.fallbacks;
      if (sweeps >= cap) count = 1;
    }
    return out;
  }
};

template <int own, int columns, bool resident>
__global__ void __launch_bounds__(most_threads, 1)
    march_steps(StepTables m, StepState s, StepArrays a, StepSpan span, StepOutcome* out) {
  extern __shared__ double memory[];
  Marcher<own, columns, resident> marcher(m, s, a, memory);
  marcher.load(span.first);
  const StepOutcome found = marcher.march(span);
  if (span.goes_on) marcher.save();
  if (blockIdx.x > 0 || threadIdx.x > 0) return;
  out->sweeps = found.sweeps;
  out->reached = found.reached;
  out->fallbacks = found.fallbacks;
}

}  // namespace

// Four rows per block if there are enough multiprocessors.
StepKernel::StepKernel(const Device& device, Index n, Index exponentials)
    : device_(device), n_(n), exponentials_(exponentials) {
  if (!choose<4, 1, true>() && !choose<4, 1, false>() && !choose<8, 2, true>() && !choose<8, 2, false>())
    kernel_ = nullptr;
}

template <int own, int columns, bool resident>
bool StepKernel::choose() {
  own_ = own;
  blocks_ = int((n_ + own - 1) / own);
  const Index across = (n_ + columns - 1) / columns;
  threads_ = int(std::max<Index>(128, (across + 31) / 32 * 32));
  if (threads_ > most_threads) return false;
  kernel_ = reinterpret_cast<const void*>(&march_steps<own, columns, resident>);
  resident_ = resident;
  shared_ = BlockMemory<own, resident>::bytes(n_, exponentials_, threads_ / 32);
  int per_multiprocessor = 0;
  if (shared_ > device_.shared_memory()) return false;
  check(cudaFuncSetAttribute(kernel_, cudaFuncAttributeMaxDynamicSharedMemorySize, int(shared_)),
        "reserving shared memory");
  check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&per_multiprocessor, kernel_, threads_, shared_),
        "asking the device");
  return Index(per_multiprocessor) * device_.multiprocessors() >= blocks_;
}

void StepKernel::form(const StepTables& tables, double* transform) const {
  form_transform<<<unsigned(blocks_), unsigned(threads_), 0, device_.stream()>>>(tables, own_, transform);
  check(cudaGetLastError(), "forming a matrix");
}

void StepKernel::launch(StepTables tables, StepState state, StepArrays arrays, StepSpan span, StepOutcome* out) const {
  check(cudaMemsetAsync(state.mail, 0, 2 * sizeof(unsigned long long) * std::size_t(n_), device_.stream()),
        "clearing the messages");
  // This limit belongs to the kernel: another plan may have lowered it.
  check(cudaFuncSetAttribute(kernel_, cudaFuncAttributeMaxDynamicSharedMemorySize, int(shared_)),
        "reserving shared memory");
  void* arguments[] = {&tables, &state, &arrays, &span, &out};
  check(
      cudaLaunchCooperativeKernel(kernel_, unsigned(blocks_), unsigned(threads_), arguments, shared_, device_.stream()),
      "starting the march");
}

}  // namespace bromwich::cuda
