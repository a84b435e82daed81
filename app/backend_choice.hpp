#pragma once

#include "core/solve/solve.hpp"

#include <memory>
#include <string>

namespace bromwich::app {

/// "auto", "cpu" or "cuda". Auto takes a CUDA device where there is one, it is predicted to be faster
/// (core/solve/method_choice.hpp) and the scene fits there with so many state components. `device_started`: this
/// process has used it already. Throws Error for another word, and for cuda where there is no device.
std::unique_ptr<Backend> choose_backend(const std::string& word, const Scene&, const Options&, Index components,
                                        int threads, bool device_started = false);

/// "cpu, cuda" with what there is of each, for `info`.
std::string backend_list();

}  // namespace bromwich::app
