#pragma once
// A job that mpirun has started: its communicator (core/seam/communicator.hpp) over MPI with values in memory of the
// host, and numbers that go to whichever rank asks first.

#include "core/seam/communicator.hpp"

#include <memory>

namespace bromwich {

/// At most one in a process. All ranks make and end it together.
class MpiJob {
 public:
  virtual ~MpiJob() = default;

  virtual Communicator& communicator() = 0;
  /// Ranks on this machine, and which of them this one is, from 0.
  virtual int neighbours() const = 0;
  virtual int number_here() const = 0;
  /// 0, 1, 2, ..: each number goes to one rank, and begins with 0 again after `restart_numbers`, which all ranks call.
  virtual Index next_number() = 0;
  virtual void restart_numbers() = 0;
  /// Whether all ranks call it within `seconds`. False: some do something else, or have ended.
  virtual bool all_arrive(double seconds) = 0;
  /// Ends all ranks at once with this exit code.
  [[noreturn]] virtual void abort(int code) = 0;
};

std::unique_ptr<MpiJob> join_mpi(int& argc, char**& argv);

/// What the part bromwich_mpi.so offers (files/loaded_part.hpp).
struct MpiPart {
  decltype(&join_mpi) join;
};

}  // namespace bromwich
