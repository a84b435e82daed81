#include "kernels/lcp_batch.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace bromwich::cuda {

namespace {

constexpr int threads = 1024;

__device__ double larger(double a, double b) { return isnan(a) || a > b ? a : b; }

// One block: the rows of a batch are few, and their outcomes lie in the second-level cache.
__global__ void reduce_rows(const RowOutcome* rows, int first, int count, double settle, BatchOutcome* out) {
  __shared__ double change[threads], magnitude[threads];
  __shared__ long long sweeps[threads];
  __shared__ int unsolved[threads], settled[threads];
  const int t = threadIdx.x;
  double my_change = 0, my_magnitude = 0;
  long long my_sweeps = 0;
  int my_unsolved = 0, my_settled = count;
  for (int j = first + t; j < count; j += threads) {
    const RowOutcome row = rows[j];
    const double relative = row.change / fmax(1.0, row.magnitude);
    my_change = larger(relative, my_change);
    my_magnitude = fmax(my_magnitude, row.magnitude);
    my_sweeps += abs(row.sweeps);
    my_unsolved += row.sweeps < 0;
    if (!(relative <= settle)) my_settled = min(my_settled, j);
  }
  change[t] = my_change, magnitude[t] = my_magnitude, sweeps[t] = my_sweeps;
  unsolved[t] = my_unsolved, settled[t] = my_settled;
  for (int half = threads / 2; half > 0; half /= 2) {
    __syncthreads();
    if (t >= half) continue;
    change[t] = larger(change[t + half], change[t]);
    magnitude[t] = fmax(magnitude[t], magnitude[t + half]);
    sweeps[t] += sweeps[t + half];
    unsolved[t] += unsolved[t + half];
    settled[t] = min(settled[t], settled[t + half]);
  }
  if (t == 0) *out = {change[0], magnitude[0], sweeps[0], unsolved[0], isfinite(change[0]) ? 1 : 0, settled[0]};
}

__global__ void reduce_largest(const double* values, int count, double* out) {
  __shared__ double found[threads];
  double mine = 0;
  for (int j = threadIdx.x; j < count; j += threads) mine = larger(values[j], mine);
  found[threadIdx.x] = mine;
  for (int half = threads / 2; half > 0; half /= 2) {
    __syncthreads();
    if (threadIdx.x < half) found[threadIdx.x] = larger(found[threadIdx.x + half], found[threadIdx.x]);
  }
  if (threadIdx.x == 0) *out = found[0];
}

void copy_row(const double* from, Vector& to, cudaStream_t stream) {
  check(cudaMemcpyAsync(to.data(), from, sizeof(double) * std::size_t(to.size()), cudaMemcpyDeviceToHost, stream),
        "copying a row from the device");
}

}  // namespace

RowOutcomes::RowOutcomes(const Device& device, Index rows) : device_(device), rows_(device, std::size_t(rows)) {
  check(cudaMallocHost(&pinned_, sizeof *pinned_), "allocating pinned memory");
}

RowOutcomes::~RowOutcomes() { cudaFreeHost(pinned_); }

BatchOutcome RowOutcomes::reduce(Index first, Index rows, double settle_tolerance) {
  reduce_rows<<<1, threads, 0, device_.stream()>>>(rows_.data(), int(first), int(rows), settle_tolerance, pinned_);
  check(cudaGetLastError(), "starting a reduction");
  device_.wait();
  return *pinned_;
}

LcpReport RowOutcomes::report(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance,
                              const std::function<ActiveSetLcp&()>& solver) {
  LcpReport report;
  report.settled = first;
  if (first >= y.rows()) return report;
  BatchOutcome sum = reduce(first, y.rows(), settle_tolerance);
  report.count.solved = y.rows() - first;
  if (sum.unsolved > 0) {
    pivot(r, v, y, first, solver(), report);
    sum = reduce(first, y.rows(), settle_tolerance);
  }
  report.count.newton = long(sum.sweeps);
  report.change = sum.change;
  report.magnitude = sum.magnitude;
  report.finite = sum.finite != 0;
  report.settled = sum.settled;
  return report;
}

void RowOutcomes::pivot(const Array& r, const Array& v, Array& y, Index first, ActiveSetLcp& solver,
                        LcpReport& report) {
  std::vector<RowOutcome> outcomes(rows_.size());
  rows_.get(outcomes.data());
  const Index n = y.cols(), step = stride(n);
  Vector q(n), part(n), old(n), fresh(n);
  for (Index j = first; j < y.rows(); ++j) {
    RowOutcome& row = outcomes[std::size_t(j)];
    if (row.sweeps >= 0) continue;
    ++report.count.fallbacks;
    copy_row(values(r) + j * step, q, device_.stream());
    copy_row(values(v) + j * step, part, device_.stream());
    copy_row(values(y) + j * step, old, device_.stream());
    device_.wait();
    q += part;
    LcpOutcome outcome;
    row.sweeps = -row.sweeps;
    row.change = std::numeric_limits<double>::quiet_NaN();
    if (q.allFinite()) {
      solver.reset();
      outcome = solver.solve(q, fresh);
      row = {(fresh - old).cwiseAbs().maxCoeff(), fresh.cwiseAbs().maxCoeff(), row.sweeps + int(outcome.newton)};
      check(cudaMemcpyAsync(values(y) + j * step, fresh.data(), sizeof(double) * std::size_t(n), cudaMemcpyHostToDevice,
                            device_.stream()),
            "copying a row to the device");
      device_.wait();
    }
    if (outcome.solved) continue;
    --report.count.solved;
    ++report.count.unsolved;
    if (outcome.infeasible && report.infeasible < 0) report.infeasible = j;
  }
  rows_.put(outcomes.data());
}

double largest(const Device& device, const Memory<double>& per_row) {
  Memory<double> result(device, 1);
  reduce_largest<<<1, threads, 0, device.stream()>>>(per_row.data(), int(per_row.size()), result.data());
  check(cudaGetLastError(), "starting a reduction");
  double value = 0;
  result.get(&value);
  return value;
}

}  // namespace bromwich::cuda
