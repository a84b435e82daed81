#pragma once
// The backend that a solve runs on, from words.

#include "batch/batch.hpp"
#include "core/seam/communicator.hpp"
#include "core/solve/kept_solver.hpp"
#include "core/solve/solve.hpp"

#include <memory>
#include <mutex>
#include <optional>
#include <string>

namespace bromwich::python {

/// A backend, used by one solve at a time.
struct Machine {
  explicit Machine(std::unique_ptr<Backend> made, std::shared_ptr<Communicator> shared = {})
      : ranks(std::move(shared)), backend(std::move(made)), kept(*backend) {}

  const std::shared_ptr<Communicator> ranks;  ///< that divide the time points of the backend; null: it has them all
  std::unique_ptr<Backend> backend;
  int device = 0;      ///< where the backend is one of a device
  MakeBackend beside;  ///< of the threads of solve_batch, kept from one call to the next; empty before the first
  KeptSolver kept;     ///< of the last call of `solve`
  std::mutex busy;

  /// What the last call of `solve` keeps takes memory from others. Nothing where a solve runs.
  void forget() {
    if (const std::unique_lock lock(busy, std::try_to_lock); lock.owns_lock()) kept.forget();
  }
};

/// What a solve is asked to run on.
struct Wanted {
  std::string backend;        ///< "auto", "cpu" or "cuda", as the command chooses
  std::optional<int> device;  ///< the number of a device; empty: the one of this process
  int number_here = 0;        ///< of this process among those of a job on this machine, which share its devices
  int threads = 0;            ///< of the host; 0: all that OpenMP offers
};

/// Backends are kept: those of devices for the whole process, that of the processor for the next solve, unless somebody
/// is using it or `own` asks for one that nobody else has. What they keep of the last solve is forgotten, but for those
/// that go on with it (`keeps`). Throws Error, naming `device`, where there is no such one.
std::shared_ptr<Machine> machine_for(const Wanted&, const Scene&, const Options&, bool own = false, bool keeps = false);

/// The time points of processors, or of the device that each rank has, divided among ranks. "auto" takes processors.
std::shared_ptr<Machine> machine_on_ranks(std::shared_ptr<Communicator>, const Wanted&, const Scene&, const Options&);

/// For what is asked of a result later, by any rank alone.
std::shared_ptr<Machine> machine_of_result(const std::shared_ptr<Machine>&, const Scene&, const Options&, int threads);

}  // namespace bromwich::python
