#pragma once
// The ranks of this command: one, or those of a job that mpirun started. All of them run the whole command; the first
// one prints and writes.

#include "core/seam/backend.hpp"
#include "core/seam/communicator.hpp"
#include "core/seam/shared_memory.hpp"

#include <functional>
#include <memory>
#include <string>

namespace bromwich::app {

/// What an entry that joined a job hands over (mpi/entry.cpp).
struct Job {
  Communicator* communicator = nullptr;
  std::function<Index()> next_number;     ///< 0, 1, 2, ..: each goes to one rank
  std::function<void()> restart_numbers;  ///< called by all ranks
  int neighbours = 1;                     ///< ranks on this machine
  int number_here = 0;                    ///< which of them this one is
  /// Whose rows travel from device to device; called by all ranks. And why there is none, in one line, or nothing.
  std::function<std::unique_ptr<Communicator>(const SharedMemory::Place&)> between_devices;
  std::function<std::string()> devices_apart;
};

/// The number of ranks that mpirun says it has started; 1 without mpirun.
int launched_ranks();

void join_job(const Job&);
const Job& job();
Communicator& ranks();
inline bool first_rank() { return ranks().rank() == 0; }

/// Throws Error, on all ranks, if mpirun started ranks that know nothing of each other, or if they run different
/// builds.
void check_ranks();
/// Threads of one rank: as many as asked for, or its share of the cores; the same on all ranks, so that they compute
/// the same where they do the same. 0: what OpenMP offers.
int threads_of_rank(int asked);
/// Why rows cannot travel between the devices of the ranks, in one line; empty if they can, and on one rank.
std::string devices_apart();
/// The time points of `backend` are divided among the ranks. Throws Error, on all ranks, if two of them share a device.
std::unique_ptr<Backend> over_ranks(std::unique_ptr<Backend> backend);

/// What this rank would have complained of; the first rank has said it.
std::string& held_complaint();

}  // namespace bromwich::app
