// The kernel along time and the sine transform along the constraints, on whole space-time arrays of J+1 rows.
//
// operation          traffic: the array in and out, and            useful operations
// convolution_scan   -                                             4 per exponential, mode and step; 2 per lag that
//                                                                  counts (core/kernel/memory_length.hpp) where that is
//                                                                  less
// convolution_fft    n spectra of J+2 complex numbers and the      2 transforms of length N = 2(J+1) a mode,
//                    weights of y_0, (J+1) x n                     2.5 N log2 N each, and N/2 complex products
// convolution_dense  -                                             2 (m^2 + m k + n m + n k) a step
// sine_transform     -                                             n^2 + 2n a row: folded, two products of half size
//
// Scan and FFT apply the kernel of the signorini scene (T = 4), the scan with compressed exponentials; the recurrence
// with a dense state has random A (m x m, stable), four inputs (k) and four outputs (n).

#include "bench/micro.hpp"

#include "catalogue/catalogue.hpp"
#include "core/kernel/compression.hpp"
#include "core/kernel/kernel.hpp"
#include "core/kernel/memory_length.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace bromwich::micro {

namespace {

constexpr double end = 4;
// The compressed kernel is fitted to 1e-11 of its largest value, and v sums J of them.
constexpr double accepted_difference = 1e-8;

struct Kernel {
  Recurrence recurrence;
  LagTable lags;
};

// Both forms of a kernel on the same input.
bool agree(const Kernel& kernel, Index J, Index inputs, Index outputs) {
  const auto y = device(Random(2).matrix(J + 1, inputs)), scan = backend().array(J + 1, outputs),
             fft = backend().array(J + 1, outputs);
  backend().convolution(kernel.recurrence, J + 1)->apply(*y, *scan, 0);
  backend().convolution(kernel.lags, J + 1)->apply(*y, *fft, 0);
  return relative_difference(host(*scan), host(*fft)) <= accepted_difference;
}

// Made once for all repetitions. Empty if the two forms of the kernel disagree.
using Kernels = std::map<std::pair<Index, Index>, std::unique_ptr<Kernel>>;

const Kernel* modal_kernel(Index n, Index J) {
  static Kernels made;
  const auto [place, fresh] = made.try_emplace({n, J});
  if (!fresh) return place->second.get();
  const Dynamics dynamics = make_scene("signorini", {{"Q", double(n)}}).dynamics;
  const auto& d = get<KroneckerDynamics>(dynamics);
  const double h = end / double(J);
  auto kernel = std::make_unique<Kernel>(Kernel{compressed_recurrence(backend(), d, compress_line_kernel(d, h, end), h),
                                                contour_lag_table(backend(), d, *contour_parameters(0), h, J)});
  if (agree(*kernel, J, n, n)) place->second = std::move(kernel);
  return place->second.get();
}

const Kernel* dense_kernel(Index m, Index J) {
  static Kernels made;
  const auto [place, fresh] = made.try_emplace({m, J});
  if (!fresh) return place->second.get();
  Random random{std::uint64_t(m)};
  const Matrix S = random.matrix(m, m);
  const DenseDynamics d{(S - S.transpose()) / 2 - Matrix::Identity(m, m), random.matrix(m, ports),
                        random.matrix(ports, m)};
  const Recurrence recurrence = dense_recurrence(d, Rule::exponential, end / double(J));
  auto kernel = std::make_unique<Kernel>(Kernel{recurrence, lag_table(recurrence, J)});
  if (agree(*kernel, J, ports, ports)) place->second = std::move(kernel);
  return place->second.get();
}

void apply(benchmark::State& state, Convolution& plan, const Field& field, double table_bytes, double flops) {
  plan.apply(*field.in, *field.out, 0);
  for (auto _ : state) plan.apply(*field.in, *field.out, 0);
  const double bytes = field.bytes() + table_bytes;
  count(state, {.bytes = bytes, .flops = flops, .footprint = bytes});
}

constexpr const char* disagreement = "scan and FFT disagree";

// Operations by exponentials, or by lags for modes with short memory: what v needs, for any backend.
double modal_flops(const ModalRecurrence& r, Index J) {
  double sum = 0;
  for (const Index lags : memory_lengths(r, J)) sum += std::min(4 * double(r.exponentials()), 2 * double(lags));
  return sum * double(J);
}

void convolution_scan(benchmark::State& state) {
  const Index n = state.range(0), J = state.range(1);
  const Kernel* kernel = modal_kernel(n, J);
  if (!kernel) return state.SkipWithError(disagreement);
  const auto& recurrence = std::get<ModalRecurrence>(kernel->recurrence);
  apply(state, *backend().convolution(kernel->recurrence, J + 1), Field(J + 1, n), 0, modal_flops(recurrence, J));
  state.counters["exponentials"] = double(recurrence.exponentials());
}

void convolution_fft(benchmark::State& state) {
  const Index n = state.range(0), J = state.range(1);
  const Kernel* kernel = modal_kernel(n, J);
  if (!kernel) return state.SkipWithError(disagreement);
  const double N = 2 * double(J + 1), spectra = 16 * double(n) * (N / 2 + 1), start = 8 * double(n * (J + 1));
  apply(state, *backend().convolution(kernel->lags, J + 1), Field(J + 1, n), spectra + start,
        double(n) * (2 * 2.5 * N * std::log2(N) + 6 * N / 2));
}

void convolution_dense(benchmark::State& state) {
  const Index m = state.range(0), J = state.range(1);
  const Kernel* kernel = dense_kernel(m, J);
  if (!kernel) return state.SkipWithError(disagreement);
  apply(state, *backend().convolution(kernel->recurrence, J + 1), Field(J + 1, ports), 0,
        2.0 * double(J) * double(m * m + 2 * m * ports + ports * ports));
  state.counters["steps"] = rate(double(J));
}

void sine_transform(benchmark::State& state) {
  const Index n = state.range(0), rows = state.range(1) + 1;
  const Field field(rows, n);
  const auto sine = backend().sine_transform(n, rows);
  const auto back = backend().array(rows, n);
  sine->apply(*field.in, nullptr, *field.out, 0);
  sine->apply(*field.out, nullptr, *back, 0);
  // S S = I, up to the rounding of two sums of n terms of size 1/sqrt(n).
  if (!(relative_difference(host(*back), host(*field.in)) <= 16 * epsilon * double(n)))
    return state.SkipWithError("the transform is not its own inverse");
  for (auto _ : state) sine->apply(*field.in, nullptr, *field.out, 0);
  count(state, {.bytes = field.bytes(), .flops = double(rows) * double(n * n + 2 * n), .footprint = field.bytes()});
}

}  // namespace

void register_convolutions() {
  benchmark::RegisterBenchmark("convolution_scan", convolution_scan)
      ->ArgsProduct({{39, 127, 511}, {400, 4096}})
      ->ArgNames({"n", "J"})
      ->UseRealTime();
  benchmark::RegisterBenchmark("convolution_fft", convolution_fft)
      ->ArgsProduct({{39, 127, 511}, {400, 4096}})
      ->ArgNames({"n", "J"})
      ->UseRealTime();
  benchmark::RegisterBenchmark("convolution_dense", convolution_dense)
      ->ArgsProduct({{8, 32, 64}, {4096}})
      ->ArgNames({"m", "J"})
      ->UseRealTime();
  benchmark::RegisterBenchmark("sine_transform", sine_transform)
      ->ArgsProduct({{39, 127, 511, 1023}, {400, 4096}})
      ->ArgNames({"n", "J"})
      ->UseRealTime();
}

}  // namespace bromwich::micro
