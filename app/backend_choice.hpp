#pragma once

#include "core/batch/batch.hpp"
#include "core/solve/solve.hpp"

#include <memory>
#include <string>

namespace bromwich::app {

/// "auto", "cpu" or "cuda". Auto chooses a CUDA device if there is one, it is predicted to be faster
/// (core/solve/method_choice.hpp), and the scene fits there with the given number of state components.
/// `device_started`: this process has used the device already. Throws Error for another word, and for cuda without a
/// device.
std::unique_ptr<Backend> choose_backend(const std::string& word, const Scene&, const Options&, Index components,
                                        int threads, bool device_started = false);

/// Backends like this one, with one thread of the host each, for scenes that are solved side by side. They are kept as
/// long as the function is: to make one on a device takes a hundredth of a second.
MakeBackend backends_beside(const Backend&);

/// "cpu, cuda" with their devices, for `info`.
std::string backend_list();

}  // namespace bromwich::app
