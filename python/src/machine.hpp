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

/// "auto", "cpu" or "cuda", as the command chooses. A CUDA backend is made once in a process and shared. threads = 0:
/// all that OpenMP offers.
std::shared_ptr<Machine> machine_for(const std::string& word, const Scene&, const Options&, int threads);

}  // namespace bromwich::python
