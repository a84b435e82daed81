#pragma once

#include "batch/batch.hpp"
#include "core/solve/solve.hpp"

#include <memory>
#include <optional>
#include <string>

namespace bromwich::app {

/// "auto", "cpu" or "cuda". Auto chooses a CUDA device if there is one, it is predicted to be faster
/// (core/solve/method_choice.hpp), and the scene fits there with the given number of state components.
/// `device_started`: this process has used the device already. `device`: its number; empty: that of this rank. Throws
/// Error for another word, for cuda without a device, and for a number that no device has.
std::unique_ptr<Backend> choose_backend(const std::string& word, const Scene&, const Options&, Index components,
                                        int threads, bool device_started = false, std::optional<int> device = {});

/// The number of a device: the given one, otherwise that of the process with this number on its machine; processes
/// share devices where there are fewer. 0 where there is none. Throws Error, naming `device`, if there is none of the
/// given number.
int device_number(std::optional<int> given, int number_here);

/// Backends like this one, with one thread of the host each, for scenes that are solved side by side. They are kept as
/// long as the function is: to make one on a device takes a hundredth of a second. `device` as for choose_backend.
MakeBackend backends_beside(const Backend&, std::optional<int> device = {});

/// "cpu, cuda" with their devices, for `info`.
std::string backend_list();

}  // namespace bromwich::app
