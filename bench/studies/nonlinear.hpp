#pragma once

#include "bench/studies/study.hpp"

namespace bromwich::app {

/// Throws Error for a SCENE: it has its own. Also on the CUDA backend if a device is found.
BenchReport bench_nonlinear(const BenchRequest& request, Backend& backend);

}  // namespace bromwich::app
