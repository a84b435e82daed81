#pragma once
// A job that mpirun has started: its communicator (core/seam/communicator.hpp) over MPI with values in memory of the
// host, and numbers that go to whichever rank asks first.

#include "core/seam/communicator.hpp"

#include <memory>
#include <string>

namespace bromwich {

/// At most one in a process. All ranks make and end it together.
class MpiJob {
 public:
  MpiJob(int& argc, char**& argv);
  ~MpiJob();
  MpiJob(const MpiJob&) = delete;
  MpiJob& operator=(const MpiJob&) = delete;

  Communicator& communicator();
  /// Ranks on this machine.
  int neighbours() const;
  /// 0, 1, 2, ..: each number goes to one rank, and begins with 0 again after `restart_numbers`, which all ranks call.
  Index next_number();
  void restart_numbers();
  /// Whether all ranks call it within `seconds`. False: some do something else, or have ended.
  bool all_arrive(double seconds);
  /// Ends all ranks at once with this exit code.
  [[noreturn]] void abort(int code);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace bromwich
