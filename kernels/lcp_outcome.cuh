#pragma once
// Counts the outcomes of a batch inside its kernel. Every thread keeps its own sums, the block adds them up at the end,
// and the last block writes those of the batch to the host. Queued batches only add to counters on the device.

#include "kernels/lcp_batch.hpp"

namespace bromwich::cuda {

__device__ inline unsigned long long bits(double value) { return (unsigned long long)(__double_as_longlong(value)); }

/// The larger of two values >= 0; NaN if one of them is.
__device__ inline double larger(double a, double b) { return bits(a) > bits(b) ? a : b; }

class Outcomes {
 public:
  __device__ explicit Outcomes(const OutcomeTarget& target) : target_(target) {}

  /// Row j is solved; `magnitude` is its largest entry, `change` the largest difference from the old y.
  __device__ void solved(int j, int sweeps, double change, double magnitude) {
    const double relative = change / fmax(1.0, magnitude);
    mine_.change = max(mine_.change, bits(relative));
    mine_.magnitude = max(mine_.magnitude, bits(magnitude));
    mine_.sweeps += sweeps;
    if (!(relative <= target_.settle_tolerance)) mine_.settled = min(mine_.settled, unsigned(j));
    target_.rows[j] = sweeps;
  }
  __device__ void unsolved(int j, int sweeps) {
    ++mine_.unsolved;
    mine_.sweeps += sweeps;
    target_.rows[j] = -sweeps;
  }

  /// Called once by all threads of the block (whole warps). `alone`: only its first thread has counted. `last_kernel`:
  /// no kernel of the same batch follows.
  template <bool alone = false, bool last_kernel = true>
  __device__ void finish() {
    __shared__ BatchOutcome block;
    if constexpr (!alone) {
      if (threadIdx.x == 0) block = empty_outcome;
      __syncthreads();
      if (mine_.sweeps > 0) add(mine_, block);
      __syncthreads();
    }
    const BatchOutcome& sum = alone ? mine_ : block;
    if (!target_.handed_over) return add(sum, *target_.totals, last_kernel);
    if constexpr (!last_kernel) {
      if (threadIdx.x == 0 && sum.sweeps > 0) add(sum, *target_.sum);
      return;
    }
    if (threadIdx.x >= 32) return;
    bool last = false;
    if (threadIdx.x == 0) {
      if (sum.sweeps > 0) add(sum, *target_.sum);
      __threadfence();
      last = atomicAdd(target_.finished, 1u) + 1 == gridDim.x;
    }
    if (__shfl_sync(~0u, last, 0)) hand_over();
  }

 private:
  __device__ static void add(const BatchOutcome& part, BatchOutcome& sum) {
    atomicMax(&sum.change, part.change);
    atomicMax(&sum.magnitude, part.magnitude);
    atomicAdd(&sum.sweeps, part.sweeps);
    if (part.unsolved > 0) atomicAdd(&sum.unsolved, part.unsolved);
    if (part.settled != ~0u) atomicMin(&sum.settled, part.settled);
  }

  __device__ static void add(const BatchOutcome& part, BatchTotals& totals, bool last_kernel) {
    if (threadIdx.x != 0) return;
    if (last_kernel && blockIdx.x == 0) atomicAdd(&totals.batches, 1ull);
    atomicMax(&totals.magnitude, part.magnitude);
    atomicAdd(&totals.sweeps, part.sweeps);
    if (part.unsolved > 0) atomicAdd(&totals.unsolved, (unsigned long long)(part.unsolved));
  }

  // By one warp, one word per lane: reads the sums accumulated by the atomics of all blocks and clears them for the
  // next batch.
  __device__ void hand_over() {
    static_assert(sizeof(BatchOutcome) == 32 && sizeof(BatchTotals) == 32);
    using Word = unsigned long long;
    const int word = int(threadIdx.x);
    const unsigned number = *target_.batches + 1;
    __threadfence();
    if (word < 4) {
      const bool counts = word == 3;  // holds `unsolved` and, in the upper half, `settled`
      const Word of_batch = atomicExch(reinterpret_cast<Word*>(target_.sum) + word, counts ? Word(~0u) << 32 : Word(0));
      Word& total = reinterpret_cast<Word*>(target_.totals)[word];
      const Word more = word == 0 ? 1 : counts ? of_batch & ~0u : of_batch;
      const Word fresh = word == 1 ? max(total, of_batch) : total + more;
      total = fresh;
      reinterpret_cast<volatile Word*>(&target_.host->sum)[word] = of_batch;
      reinterpret_cast<volatile Word*>(&target_.host->totals)[word] = fresh;
    }
    __threadfence_system();
    __syncwarp();
    if (word != 0) return;
    *target_.finished = 0;
    *target_.batches = number;
    *static_cast<volatile unsigned*>(&target_.host->batches) = number;
  }

  const OutcomeTarget target_;
  BatchOutcome mine_ = empty_outcome;
};

}  // namespace bromwich::cuda
