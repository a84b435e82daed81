#pragma once

#include "core/solve.hpp"

#include <memory>
#include <string>

namespace bromwich::app {

/// "auto", "cpu" or "cuda". Auto takes a CUDA device where there is one, the method solves all time points at once and
/// the scene fits there with so many state components. Throws Error for another word, and for cuda where there is no
/// device.
std::unique_ptr<Backend> choose_backend(const std::string& word, const Scene&, const Options&, Index components,
                                        int threads);

/// "cpu, cuda" with what there is of each, for `info`.
std::string backend_list();

}  // namespace bromwich::app
