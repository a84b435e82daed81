// The communicator of MPI and its numbers, under mpirun.

#include "mpi/mpi_job.hpp"
#include "tests/support/communicator_contract.hpp"

#include <cstdio>

namespace bromwich {
namespace {

// Each of them goes to one rank, and all go.
void check_numbers(MpiJob& job, std::vector<std::string>& faults) {
  constexpr Index count = 100;
  for (int round = 0; round < 2; ++round) {
    job.restart_numbers();
    Vector mine = Vector::Zero(count);
    for (Index k = job.next_number(); k < count; k = job.next_number()) mine[k] += 1;
    if ((job.communicator().gather(mine).colwise().sum().array() != 1).any())
      faults.emplace_back("a number goes to no rank or to two");
  }
}

int run(int argc, char** argv) {
  const std::unique_ptr<MpiJob> joined = join_mpi(argc, argv);
  MpiJob& job = *joined;
  std::vector<std::string> faults = faults_of(job.communicator());
  check_numbers(job, faults);
  const int ranks = job.communicator().size();
  if (job.neighbours() < 1 || job.neighbours() > ranks) faults.emplace_back("neighbours are no part of the ranks");
  if (!job.all_arrive(60)) faults.emplace_back("all ranks are here, and are not seen");
  for (const std::string& fault : faults) std::fprintf(stderr, "%s\n", fault.c_str());
  const Vector found = Vector::Constant(1, double(faults.size()));
  return job.communicator().gather(found).sum() > 0 ? 1 : 0;
}

}  // namespace
}  // namespace bromwich

int main(int argc, char** argv) { return bromwich::run(argc, argv); }
