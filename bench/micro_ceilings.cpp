// Limits of the machine, with as many threads as the backend.
//
// name      per value                      bytes  what
// copy      a = b                          16     the C library's copy, which bypasses the caches for large blocks
// triad     a = b + s c                    24     STREAM's triad (McCalpin 1995)
// update    a = a + b + c                  32     the streams of the batched complementarity problems
// gemm      C += A B, square matrices      -      Eigen, one product a thread
// fma       a = a b + c in registers       -      eight doubles at a time
// divide    a = 1/a in registers           -      eight doubles at a time
//
// Bytes are counted as in STREAM: the cache lines that a store loads first are not counted. Every thread allocates,
// first touches and then streams arrays of its own, and repeats its pass inside one parallel region until
// `least_traffic` has moved, so that small sizes measure the caches and not the start of threads.

#include "bench/micro.hpp"

#include <omp.h>
#include <unistd.h>

#include <algorithm>
#include <vector>

namespace bromwich::micro {

namespace {

constexpr double least_traffic = 1 << 24;
constexpr double smallest_footprint = 1 << 15, least_largest = double(1 << 30);

struct Arrays {
  Vector a, b, c;
};

void copy(Arrays& x, Index size) { std::copy_n(x.b.data(), size, x.a.data()); }
void triad(Arrays& x, Index size) { x.a.head(size).noalias() = x.b.head(size) + 0.5 * x.c.head(size); }
void update(Arrays& x, Index size) { x.a.head(size) += x.b.head(size) + x.c.head(size); }

// Four times the last-level cache, if memory allows: a power of two, in bytes over all arrays and threads.
double largest_footprint() {
  static const double found = [] {
    const double cache = double(std::max(0L, sysconf(_SC_LEVEL3_CACHE_SIZE)));
    const double memory = double(sysconf(_SC_AVPHYS_PAGES)) * double(sysconf(_SC_PAGE_SIZE));
    double size = least_largest;
    while (size < 4 * cache && size < memory / 8) size *= 2;
    return size;
  }();
  return found;
}

// One set of arrays per thread for all sizes: two arrays have the largest footprint, smaller sizes use their front.
std::vector<Arrays>& parts() {
  static std::vector<Arrays> made = [] {
    std::vector<Arrays> all(static_cast<std::size_t>(threads()));
    const Index size = Index(largest_footprint()) / (2 * Index(sizeof(double)) * threads());
#pragma omp parallel num_threads(threads())
    {
      Arrays& mine = all[std::size_t(omp_get_thread_num())];
      for (Vector* x : {&mine.a, &mine.b, &mine.c}) *x = Vector::Ones(size);
    }
    return all;
  }();
  return made;
}

// `arrays` arrays have `footprint` bytes over all threads; a pass reads or writes `streams` arrays.
void stream(benchmark::State& state, void (*pass)(Arrays&, Index), int arrays, int streams) {
  const double footprint = double(state.range(0));
  const Index size = Index(footprint) / (Index(sizeof(double)) * arrays * threads()) / 8 * 8;
  const double traffic = double(sizeof(double)) * double(size) * streams * threads();
  const Index passes = std::max<Index>(1, Index(least_traffic / traffic));
  std::vector<Arrays>& all = parts();
  for (auto _ : state) {
#pragma omp parallel num_threads(threads())
    for (Index p = 0; p < passes; ++p) {
      pass(all[std::size_t(omp_get_thread_num())], size);
      benchmark::ClobberMemory();
    }
  }
  count(state, {.bytes = traffic * double(passes), .footprint = footprint});
}

void gemm(benchmark::State& state) {
  const Index n = state.range(0), passes = std::max<Index>(1, (1 << 24) / (n * n * n));
  std::vector<Matrix> A(static_cast<std::size_t>(threads()), Matrix::Constant(n, n, 0.5)), B(A), C(A);
  for (auto _ : state) {
#pragma omp parallel num_threads(threads())
    for (Index p = 0; p < passes; ++p) {
      const std::size_t t = std::size_t(omp_get_thread_num());
      C[t].noalias() += A[t] * B[t];
      benchmark::ClobberMemory();
    }
  }
  count(state, {.flops = 2.0 * double(n * n * n * passes) * threads(), .footprint = 24.0 * double(n * n) * threads()});
}

typedef double Wide __attribute__((vector_size(64)));
#if defined(__AVX512F__)
constexpr int chains = 12;  // two units with latency four need eight
#else
constexpr int chains = 4;  // of two or more registers each
#endif
constexpr long rounds = 1 << 15;

// Repeats `step` on `chains` independent values, in a local copy that stays in registers.
template <class Step>
void in_registers(Step step) {
#pragma omp parallel num_threads(threads())
  {
    Wide x[chains] = {}, values[chains];
    for (Wide& value : x) value += 1.5;
    benchmark::DoNotOptimize(x);
    for (int c = 0; c < chains; ++c) values[c] = x[c];
    for (long r = 0; r < rounds; ++r) {
#pragma GCC unroll 16
      for (int c = 0; c < chains; ++c) step(values[c]);
    }
    for (int c = 0; c < chains; ++c) x[c] = values[c];
    benchmark::DoNotOptimize(x);
  }
}

void fma(benchmark::State& state) {
  double factor = 0.5, term = 1;
  benchmark::DoNotOptimize(factor);
  benchmark::DoNotOptimize(term);
  for (auto _ : state) in_registers([=](Wide& value) { value = value * factor + term; });
  count(state, {.flops = 2.0 * 8 * chains * rounds * threads()});
}

void divide(benchmark::State& state) {
  for (auto _ : state) in_registers([](Wide& value) { value = 1.0 / value; });
  count(state, {.divisions = 8.0 * chains * rounds * threads()});
}

}  // namespace

void register_ceilings() {
  const auto add = [largest = largest_footprint()](const char* name, void (*pass)(Arrays&, Index), int arrays,
                                                   int streams) {
    auto* made =
        benchmark::RegisterBenchmark(name, [=](benchmark::State& state) { stream(state, pass, arrays, streams); });
    for (double size = smallest_footprint; size <= largest; size *= 2) made->Arg(long(size));
    made->ArgName("bytes")->UseRealTime();
  };
  add("copy", copy, 2, 2);
  add("triad", triad, 3, 3);
  add("update", update, 3, 4);
  benchmark::RegisterBenchmark("gemm", gemm)->RangeMultiplier(2)->Range(64, 512)->ArgName("n")->UseRealTime();
  benchmark::RegisterBenchmark("fma", fma)->UseRealTime();
  benchmark::RegisterBenchmark("divide", divide)->UseRealTime();
}

}  // namespace bromwich::micro
