// The command with MPI, where mpirun has started it; elsewhere as without.

#include "app/commands.hpp"
#include "app/interaction.hpp"
#include "app/ranks.hpp"
#include "files/loaded_part.hpp"
#include "kernels/nccl_communicator.hpp"
#include "mpi/mpi_job.hpp"

#include <cstdio>
#include <memory>
#include <string>

namespace bromwich::app {

namespace {

constexpr double patience = 2;  ///< seconds after a refusal; others have refused the same, or are at work

const LoadedPart& nccl() {
  static const LoadedPart part = load_part("nccl");
  return part;
}

void say(int rank) {
  if (held_complaint().empty()) return;
  std::fprintf(stderr, "bromwich: rank %d: %s\n", rank, held_complaint().c_str());
  std::fflush(stderr);
}

int command_of_job(int argc, char** argv) {
  const LoadedPart part = load_part("mpi", PartLibraries::seen);  // by what MPI loads itself
  if (!part.functions) {
    std::fprintf(stderr, "bromwich: mpirun: %s; install the command again, with its libraries\n", part.missing.c_str());
    return exit_bad_input;
  }
  const std::unique_ptr<MpiJob> joined = static_cast<const MpiPart*>(part.functions)->join(argc, argv);
  MpiJob& job = *joined;
  join_job({.communicator = &job.communicator(),
            .next_number = [&job] { return job.next_number(); },
            .restart_numbers = [&job] { job.restart_numbers(); },
            .neighbours = job.neighbours(),
            .number_here = job.number_here(),
            .between_devices =
                [&job](const SharedMemory::Place& place) {
                  return static_cast<const NcclPart*>(nccl().functions)->make(job.communicator(), place);
                },
            .devices_apart = [] { return nccl().missing; }});
  const int rank = job.communicator().rank();
  const int code = command(argc, argv);
  if (!job.all_arrive(code == exit_bad_input ? patience : 1e9)) {
    say(rank);
    job.abort(code);
  }
  const RowMatrix codes = job.communicator().gather(Vector::Constant(1, code));
  if (code == exit_bad_input && codes(0, 0) != code) say(rank);
  return int(codes.maxCoeff());
}

}  // namespace

}  // namespace bromwich::app

int main(int argc, char** argv) {
  using namespace bromwich::app;
  return launched_ranks() > 1 ? command_of_job(argc, argv) : command(argc, argv);
}
