#pragma once

#include "core/solve.hpp"

#include <memory>
#include <string>

namespace bromwich::app {

/// "auto", "cpu" or "cuda". Auto takes a CUDA device where there is one and the method solves all time points at once.
/// Throws Error for another word, and for cuda where there is no device.
std::unique_ptr<Backend> choose_backend(const std::string& word, Method method, int threads);

/// "cpu, cuda" with what there is of each, for `info`.
std::string backend_list();

}  // namespace bromwich::app
