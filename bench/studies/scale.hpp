#pragma once

#include "bench/studies/study.hpp"

namespace bromwich::app {

/// Under mpirun: on its ranks. Without: predictions alone, from terms that are given.
BenchReport bench_scale(const BenchRequest& request, Backend& backend);

}  // namespace bromwich::app
