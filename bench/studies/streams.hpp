#pragma once

#include "bench/studies/study.hpp"

namespace bromwich::app {

/// Throws Error for a SCENE: it has its own, and without a CUDA device.
BenchReport bench_streams(const BenchRequest& request, Backend& backend);

}  // namespace bromwich::app
