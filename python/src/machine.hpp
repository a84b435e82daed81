#pragma once
// The backend that a solve runs on, from words.

#include "core/batch/batch.hpp"
#include "core/seam/communicator.hpp"
#include "core/solve/solve.hpp"

#include <memory>
#include <mutex>
#include <string>

namespace bromwich::python {

/// A backend, used by one solve at a time.
struct Machine {
  explicit Machine(std::unique_ptr<Backend> made, std::shared_ptr<Communicator> shared = {})
      : ranks(std::move(shared)), backend(std::move(made)) {}

  const std::shared_ptr<Communicator> ranks;  ///< that divide the time points of the backend; null: it has them all
  std::unique_ptr<Backend> backend;
  MakeBackend beside;  ///< of the threads of solve_batch, kept from one call to the next; empty before the first
  std::mutex busy;
};

/// "auto", "cpu" or "cuda", as the command chooses. threads = 0: all that OpenMP offers. Backends are kept: that of a
/// device for the whole process, that of the processor for the next solve, unless somebody is using it or `own` asks
/// for one that nobody else has.
std::shared_ptr<Machine> machine_for(const std::string& word, const Scene&, const Options&, int threads,
                                     bool own = false);

/// The time points of a processor divided among ranks. Throws Error, naming `backend`, for words that want a device.
std::shared_ptr<Machine> machine_on_ranks(std::shared_ptr<Communicator>, const std::string& word, int threads);

/// For what is asked of a result later, by any rank alone.
std::shared_ptr<Machine> machine_of_result(const std::shared_ptr<Machine>&, const Scene&, const Options&, int threads);

}  // namespace bromwich::python
