#pragma once
// Common parts of the micro-benchmarks: one backend, arrays of random numbers with fixed seeds, the counters of a row.
//
// counter           meaning, all of one call
// bytes_per_second  compulsory traffic: every input read once, every output written once, tables of the plan included
// flops             useful floating-point operations per second; a multiply-add is two, a complex one eight
// divisions         divisions per second that the code performs
// footprint         bytes of everything a call reads or writes: the size at which the memory ceiling is measured

#include "core/seam/backend.hpp"

#include <benchmark/benchmark.h>

#include <cstdint>
#include <memory>
#include <random>

namespace bromwich::micro {

/// All threads, or OMP_NUM_THREADS of them.
Backend& backend();
int threads();

/// Uniform numbers, the same on every machine.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}

  double uniform(double low, double high) { return low + (high - low) * double(engine_() >> 11) * 0x1p-53; }
  Matrix matrix(Index rows, Index cols);

 private:
  std::mt19937_64 engine_;
};

std::unique_ptr<Array> device(const RowMatrix& values);
RowMatrix host(const Array& array);

inline constexpr Index ports = 4;  ///< inputs and outputs of the dense dynamics

/// Random input and an output of the same shape.
struct Field {
  Field(Index rows, Index n);
  double bytes() const { return double(in->bytes() + out->bytes()); }

  std::unique_ptr<Array> in, out;
};

/// Operations of one call; zero if not counted.
struct Work {
  double bytes = 0, flops = 0, divisions = 0, footprint = 0;
};
void count(benchmark::State& state, const Work& work);

/// A rate from `each` items per call.
benchmark::Counter rate(double each);

/// max |a - b| / max |b|; infinite if a value is not finite.
double relative_difference(const RowMatrix& a, const RowMatrix& b);

void register_ceilings();
void register_lcp();
void register_convolutions();
void register_resolvents();
void register_marches();

}  // namespace bromwich::micro
