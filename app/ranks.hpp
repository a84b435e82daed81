#pragma once
// The ranks of this command: one, or those of a job that mpirun started. All of them run the whole command; the first
// one prints and writes.

#include "core/seam/backend.hpp"
#include "core/seam/communicator.hpp"

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
/// The time points of `backend`, which `word` named, are divided among the ranks.
std::unique_ptr<Backend> over_ranks(std::unique_ptr<Backend> backend, const std::string& word);

/// What this rank would have complained of; the first rank has said it.
std::string& held_complaint();

}  // namespace bromwich::app
