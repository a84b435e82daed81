#pragma once
// Counting what becomes of a batch inside its kernel: every thread keeps sums of its own, the block adds them up at the
// end, and the last block to finish hands those of the batch to the host.

#include "kernels/lcp_batch.hpp"

namespace bromwich::cuda {

__device__ inline unsigned long long bits(double value) { return (unsigned long long)(__double_as_longlong(value)); }

/// Of two values >= 0; NaN where one is.
__device__ inline double larger(double a, double b) { return bits(a) > bits(b) ? a : b; }

class Outcomes {
 public:
  __device__ explicit Outcomes(const OutcomeTarget& target) : target_(target) {}

  /// Row j has a solution whose largest entry is `magnitude`, and whose largest difference from the last is `change`.
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

  /// By all threads of the block, once.
  __device__ void finish() {
    __shared__ BatchOutcome block;
    if (threadIdx.x == 0) block = empty_outcome;
    __syncthreads();
    if (mine_.sweeps > 0) add(mine_, block);
    __syncthreads();
    if (threadIdx.x != 0) return;
    if (block.sweeps > 0) add(block, *target_.sum);
    __threadfence();
    if (atomicAdd(target_.finished, 1u) + 1 == gridDim.x) hand_over();
  }

 private:
  __device__ static void add(const BatchOutcome& part, BatchOutcome& sum) {
    atomicMax(&sum.change, part.change);
    atomicMax(&sum.magnitude, part.magnitude);
    atomicAdd(&sum.sweeps, part.sweeps);
    atomicAdd(&sum.unsolved, part.unsolved);
    atomicMin(&sum.settled, part.settled);
  }

  // The sums are taken from where the atomics of the other blocks left them, and emptied for the next batch.
  __device__ void hand_over() {
    __threadfence();
    BatchOutcome& sum = *target_.sum;
    BatchTotals& totals = *target_.totals;
    volatile BatchOutcome& host = target_.host->sum;
    volatile BatchTotals& host_totals = target_.host->totals;
    host_totals.magnitude = totals.magnitude = max(totals.magnitude, atomicMax(&sum.magnitude, 0ull));
    host_totals.sweeps = totals.sweeps += atomicAdd(&sum.sweeps, 0ull);
    host_totals.unsolved = totals.unsolved += atomicAdd(&sum.unsolved, 0u);
    host.change = atomicExch(&sum.change, empty_outcome.change);
    host.magnitude = atomicExch(&sum.magnitude, empty_outcome.magnitude);
    host.sweeps = atomicExch(&sum.sweeps, empty_outcome.sweeps);
    host.unsolved = atomicExch(&sum.unsolved, empty_outcome.unsolved);
    host.settled = atomicExch(&sum.settled, empty_outcome.settled);
    atomicExch(target_.finished, 0u);
    __threadfence_system();
    const unsigned number = ++*target_.batches;
    *static_cast<volatile unsigned*>(&target_.host->batches) = number;
  }

  const OutcomeTarget target_;
  BatchOutcome mine_ = empty_outcome;
};

}  // namespace bromwich::cuda
