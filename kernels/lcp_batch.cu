#include "kernels/lcp_batch.hpp"

#include "core/base/error.hpp"
#include "kernels/lcp_outcome.cuh"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

namespace bromwich::cuda {

namespace {

constexpr int threads = 1024;

// One block suffices: the values of a batch are few and in the L2 cache.
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

Vector row_of(const double* array, Index j, Index n, cudaStream_t stream) {
  Vector row(n);
  check(cudaMemcpyAsync(row.data(), array + j * stride(n), sizeof(double) * std::size_t(n), cudaMemcpyDeviceToHost,
                        stream),
        "copying a row from the device");
  check(cudaStreamSynchronize(stream), "copying a row from the device");
  return row;
}

void put_row(const Vector& row, double* array, Index j, cudaStream_t stream) {
  check(cudaMemcpyAsync(array + j * stride(row.size()), row.data(), sizeof(double) * std::size_t(row.size()),
                        cudaMemcpyHostToDevice, stream),
        "copying a row to the device");
  check(cudaStreamSynchronize(stream), "copying a row to the device");
}

}  // namespace

TotalsBoard::~TotalsBoard() {
  for (Page& page : pages_) cudaFreeHost(page.fetched);
}

TotalsBoard::Place TotalsBoard::take() {
  if (free_.empty()) {
    BatchTotals* fetched = nullptr;
    check(cudaMallocHost(&fetched, of_page * sizeof(BatchTotals)), "allocating pinned memory");
    pages_.push_back({Memory<BatchTotals>(), fetched});
    Memory<BatchTotals>& on_device = pages_.back().on_device = Memory<BatchTotals>(device_, of_page);
    on_device.clear();
    for (std::size_t i = of_page; i-- > 0;) free_.push_back({on_device.data() + i, fetched + i});
  }
  const Place place = free_.back();
  check(cudaMemsetAsync(place.on_device, 0, sizeof(BatchTotals), device_.stream()), "clearing device memory");
  device_.note_work();
  free_.pop_back();
  return place;
}

void TotalsBoard::fetch() {
  if (fetched_ == device_.work()) return;
  for (const Page& page : pages_)
    check(cudaMemcpyAsync(page.fetched, page.on_device.data(), page.on_device.bytes(), cudaMemcpyDeviceToHost,
                          device_.stream()),
          "copying from the device");
  device_.wait();
  fetched_ = device_.work();
}

BatchOutcomes::BatchOutcomes(const Device& device, Index rows, double shift)
    : device_(device),
      rows_(device, std::size_t(rows)),
      shift_(shift),
      sum_(device, 1),
      board_(device.shared<TotalsBoard>([](const TotalsBoard&) { return true; },
                                        [&] { return std::make_shared<TotalsBoard>(device); })),
      totals_(board_->take()),
      counters_(device, 2),
      handed_over_(device, {empty_outcome, {0, 0, 0, 0}, 0}) {
  sum_.put(&empty_outcome);
  counters_.clear();
}

OutcomeTarget BatchOutcomes::target(Index problems, double settle_tolerance, bool handed_over) {
  problems_ = problems;
  return {rows_.data(),     totals_.on_device,    handed_over,        sum_.data(),
          counters_.data(), counters_.data() + 1, handed_over_.get(), settle_tolerance};
}

LcpReport BatchOutcomes::collect() {
  board_->fetch();
  const BatchTotals &now = *totals_.fetched, &then = reported_;
  LcpReport report;
  report.count.unsolved = long(now.unsolved - then.unsolved);
  report.count.solved = long(now.batches - then.batches) * long(problems_) - report.count.unsolved;
  report.count.newton = long(now.sweeps - then.sweeps);
  report.magnitude = std::bit_cast<double>(now.magnitude);
  reported_ = now;
  batches_ = handed_over_->batches;
  return report;
}

// Polling the counter is some microseconds faster than synchronising with the stream.
BatchOutcome BatchOutcomes::wait() {
  ++batches_;
  const std::atomic_ref<unsigned> batches(handed_over_->batches);
  for (unsigned looks = 1; batches.load(std::memory_order_acquire) != batches_; ++looks) {
    if (looks % 4096 != 0 || cudaStreamQuery(device_.stream()) == cudaErrorNotReady) continue;
    device_.wait();  // throws if the kernel failed
    if (batches.load(std::memory_order_acquire) != batches_)
      throw Error("cuda", "a batch of complementarity problems was not handed over", "collect it", ErrorKind::internal);
  }
  reported_ = handed_over_->totals;
  return handed_over_->sum;
}

LcpReport BatchOutcomes::report(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance,
                                const std::function<ActiveSetLcp&()>& solver) {
  LcpReport report;
  report.settled = std::min(first, y.rows());
  if (first >= y.rows()) return report;
  const BatchOutcome sum = wait();
  report.count.solved = y.rows() - first;
  report.count.newton = long(sum.sweeps);
  report.change = std::bit_cast<double>(sum.change);
  report.magnitude = std::bit_cast<double>(sum.magnitude);
  report.settled = std::min(Index(sum.settled), y.rows());
  if (sum.unsolved > 0) pivot(r, v, y, first, settle_tolerance, solver(), report);
  report.finite = std::isfinite(report.change);
  return report;
}

void BatchOutcomes::pivot(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance,
                          ActiveSetLcp& solver, LcpReport& report) {
  std::vector<int> sweeps(rows_.size());
  rows_.get(sweeps.data());
  const cudaStream_t stream = device_.stream();
  for (Index j = first; j < y.rows(); ++j) {
    if (sweeps[std::size_t(j)] >= 0) continue;
    ++report.count.fallbacks;
    const Vector old = row_of(values(y), j, y.cols(), stream);  // an unsolved row still has its old y
    const Vector q = row_of(values(r), j, y.cols(), stream) + row_of(values(v), j, y.cols(), stream) - shift_ * old;
    LcpOutcome outcome;
    double change = std::numeric_limits<double>::quiet_NaN();
    if (q.allFinite()) {
      Vector fresh;
      solver.reset();
      outcome = solver.solve(q, fresh);
      const double magnitude = fresh.cwiseAbs().maxCoeff();
      change = (fresh - old).cwiseAbs().maxCoeff() / std::max(1.0, magnitude);
      report.magnitude = std::max(report.magnitude, magnitude);
      report.count.newton += outcome.newton;
      put_row(fresh, values(y), j, stream);
    }
    if (std::isnan(change) || change > report.change) report.change = change;
    if (!outcome.solved || !(change <= settle_tolerance)) report.settled = std::min(report.settled, j);
    if (outcome.solved) continue;
    --report.count.solved;
    ++report.count.unsolved;
    if (outcome.infeasible && report.infeasible < 0) report.infeasible = j;
  }
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
