#pragma once

#include "../core/seam/backend.hpp"

#include <memory>

namespace bromwich {

/// The OpenMP + FFTW backend. threads = 0 takes what OpenMP offers (OMP_NUM_THREADS, or all cores). Throws Error for a
/// negative number.
std::unique_ptr<Backend> make_cpu_backend(int threads = 0);

}  // namespace bromwich
