#pragma once
// The backend that a solve runs on, from words.

#include "core/solve/solve.hpp"

#include <memory>
#include <mutex>
#include <string>

namespace bromwich::python {

/// A backend, used by one solve at a time.
struct Machine {
  explicit Machine(std::unique_ptr<Backend> made) : backend(std::move(made)) {}

  std::unique_ptr<Backend> backend;
  std::mutex busy;
};

/// "auto", "cpu" or "cuda", as the command chooses. threads = 0: all that OpenMP offers. Backends are kept: that of a
/// device for the whole process, that of the processor for the next solve, unless somebody is using it or `own` asks
/// for one that nobody else has.
std::shared_ptr<Machine> machine_for(const std::string& word, const Scene&, const Options&, int threads,
                                     bool own = false);

}  // namespace bromwich::python
