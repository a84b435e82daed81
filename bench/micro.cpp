// Micro-benchmarks of the operations behind the seam (Google Benchmark), through the public Backend interface.
//
//     build/cpu/bench/bench_micro --benchmark_format=json
//
// Counters: bytes_per_second counts compulsory traffic (each input read once, each output written once); flops counts
// useful floating-point operations.

#include "core/backend.hpp"
#include "core/compression.hpp"
#include "core/kernel.hpp"
#include "core/scenes/catalogue.hpp"
#include "cpu/cpu_backend.hpp"

#include <benchmark/benchmark.h>

#include <cmath>
#include <vector>

namespace {

using namespace bromwich;

Backend& backend() {
  static const auto made = make_cpu_backend();
  return *made;
}

RowMatrix waves(Index rows, Index cols) {
  RowMatrix values(rows, cols);
  for (Index j = 0; j < rows; ++j)
    for (Index i = 0; i < cols; ++i) values(j, i) = std::sin(0.01 * double(j) + 0.7 * double(i * i % 17));
  return values;
}

KroneckerDynamics signorini(Index Q) {
  return std::get<KroneckerDynamics>(make_scene("signorini", {{"Q", double(Q)}}).dynamics);
}

struct Field {
  std::unique_ptr<Array> in, out;
  Field(Index rows, Index n) : in(backend().array(rows, n)), out(backend().array(rows, n)) {
    backend().upload(waves(rows, n), *in);
  }
  void traffic(benchmark::State& state) const {
    state.SetBytesProcessed(state.iterations() * long(in->bytes() + out->bytes()));
  }
};

void flops(benchmark::State& state, double each) {
  state.counters["flops"] =
      benchmark::Counter(each, benchmark::Counter::kIsIterationInvariantRate, benchmark::Counter::kIs1000);
}

void sine_transform(benchmark::State& state) {
  const Index n = state.range(0), rows = state.range(1) + 1;
  const Field field(rows, n);
  const auto sine = backend().sine_transform(n, rows);
  for (auto _ : state) sine->apply(*field.in, nullptr, *field.out, 0);
  field.traffic(state);
}
BENCHMARK(sine_transform)->ArgsProduct({{39, 127, 511, 1023}, {400, 4096}})->ArgNames({"n", "J"})->UseRealTime();

void convolution_scan(benchmark::State& state) {
  const Index n = state.range(0), J = state.range(1);
  const KroneckerDynamics d = signorini(n);
  const double h = 4.0 / double(J);
  const ExponentialSum sum = compress_line_kernel(d, h, 4, 1e-13);
  const auto scan = backend().convolution(Recurrence(compressed_recurrence(backend(), d, sum, h)), J + 1);
  const Field field(J + 1, n);
  for (auto _ : state) scan->apply(*field.in, *field.out, 0);
  field.traffic(state);
  flops(state, 4.0 * double(sum.rates.size() * n * J));
  state.counters["exponentials"] = double(sum.rates.size());
}
BENCHMARK(convolution_scan)->ArgsProduct({{39, 127, 511}, {400, 4096}})->ArgNames({"n", "J"})->UseRealTime();

void convolution_fft(benchmark::State& state) {
  const Index n = state.range(0), J = state.range(1);
  const KroneckerDynamics d = signorini(n);
  const auto fft =
      backend().convolution(contour_lag_table(backend(), d, *contour_parameters(0), 4.0 / double(J), J), J + 1);
  const Field field(J + 1, n);
  for (auto _ : state) fft->apply(*field.in, *field.out, 0);
  field.traffic(state);
}
BENCHMARK(convolution_fft)->ArgsProduct({{39, 127, 511}, {400, 4096}})->ArgNames({"n", "J"})->UseRealTime();

// Warm: every call starts from the solution, as the last sweeps of an iteration do.
void lcp(benchmark::State& state, const LcpMatrix& M, LcpClass lcp_class) {
  const Index n = size(M), rows = state.range(1);
  const Field field(rows, n);
  const auto y = backend().array(rows, n);
  const auto batch = backend().lcp(M, lcp_class, rows);
  batch->solve(*field.in, *field.out, *y, 0, 0);
  long newton = 0;
  for (auto _ : state) newton += batch->solve(*field.in, *field.out, *y, 0, 0).count.newton;
  state.counters["problems"] = benchmark::Counter(double(rows), benchmark::Counter::kIsIterationInvariantRate);
  state.counters["sweeps"] = double(newton) / double(rows * state.iterations());
  state.SetBytesProcessed(state.iterations() * rows * n * 32);  // r, v and y read, y written
}

void lcp_tridiagonal(benchmark::State& state) {
  const Index n = state.range(0);
  lcp(state, Tridiagonal{Vector::Constant(n, -1), Vector::Constant(n, 4), Vector::Constant(n, -1)}, LcpClass::P);
}
BENCHMARK(lcp_tridiagonal)->ArgsProduct({{39, 127, 511, 1023}, {4096}})->ArgNames({"n", "rows"})->UseRealTime();

void lcp_dense(benchmark::State& state) {
  const Index n = state.range(0);
  Matrix M = Matrix::Identity(n, n) * (double(n) + 1);
  for (Index i = 0; i < n; ++i)
    for (Index k = 0; k < n; ++k)
      if (i != k) M(i, k) = std::cos(double(3 * i + 5 * k));
  lcp(state, M, LcpClass::P);
}
BENCHMARK(lcp_dense)->ArgsProduct({{1, 2, 4, 8, 16, 32}, {4096}})->ArgNames({"n", "rows"})->UseRealTime();

void resolvent(benchmark::State& state) {
  const KroneckerDynamics d = signorini(state.range(0));
  const ComplexVector nodes = window_contour(*contour_parameters(0), 0.01).nodes;
  for (auto _ : state) benchmark::DoNotOptimize(backend().resolvent(d, nodes));
  state.counters["solves"] =
      benchmark::Counter(double(nodes.size() * state.range(0)), benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(resolvent)->Arg(39)->Arg(511)->ArgName("n")->UseRealTime();

// What the machine can do: the ceiling of everything above that streams.
void copy(benchmark::State& state) {
  const std::size_t size = std::size_t(state.range(0));
  std::vector<double> from(size, 1.0), to(size);
  for (auto _ : state) {
    std::copy(from.begin(), from.end(), to.begin());
    benchmark::ClobberMemory();
  }
  state.SetBytesProcessed(state.iterations() * long(2 * sizeof(double) * size));
}
BENCHMARK(copy)->Arg(1 << 15)->Arg(1 << 24);

}  // namespace

BENCHMARK_MAIN();
