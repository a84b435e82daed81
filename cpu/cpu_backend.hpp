#pragma once

#include "bromwich/backend.hpp"

#include <memory>

namespace bromwich {

struct BackendTraits;

/// The backend on OpenMP. threads = 0 uses what OpenMP offers (OMP_NUM_THREADS, or all cores). Throws Error for a
/// negative number.
std::unique_ptr<Backend> make_cpu_backend(int threads = 0);

/// Fitted to `bench auto` (bench/results/auto*.json) on x86-64 processors with 2 and 16 cores. Marching was the fastest
/// method throughout that study.
BackendTraits cpu_traits();

}  // namespace bromwich
