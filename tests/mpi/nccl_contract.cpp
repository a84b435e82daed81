// The communicator of NCCL, under mpirun: its contract where each rank has a device of its own, and a divided solve;
// its refusal where two ranks share one. Exit code 77: no device.

#include "core/base/error.hpp"
#include "core/catalogue/catalogue.hpp"
#include "core/slabs/slab_backend.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"
#include "kernels/nccl_communicator.hpp"
#include "mpi/mpi_job.hpp"
#include "tests/support/communicator_contract.hpp"

#include <algorithm>
#include <cstdio>
#include <string>
#include <utility>

namespace bromwich {
namespace {

// Sweeps end at a change of 1e-14; transforms of the device and of the host round otherwise, and sums of carries too.
constexpr double same_solution = 1e-11;

void check_solve(Communicator& ranks, std::unique_ptr<Backend> cuda, std::vector<std::string>& faults) {
  const Scene scene = make_scene("signorini", {{"Q", 15}});
  Options options;
  options.method = Method::contour;
  options.steps = 1024;
  options.iteration_tolerance = 1e-14;
  const auto host = make_cpu_backend(1);
  const RowMatrix expected = solve(scene, *host, options).y;
  const auto divided = make_slab_backend(std::move(cuda), ranks);
  const Result found = solve(scene, *divided, options);
  if (found.status != Status::solved) faults.push_back("the divided solve ends: " + found.reason);
  if (!((found.y - expected).cwiseAbs().maxCoeff<Eigen::PropagateNaN>() <= same_solution))
    faults.emplace_back("the divided solve finds another solution than the host");
}

void check_devices_of_their_own(MpiJob& job, std::unique_ptr<Backend> cuda, std::vector<std::string>& faults) {
  const auto ranks = make_nccl_communicator(job.communicator(), *cuda);
  faults = faults_of(*ranks);
  check_solve(*ranks, std::move(cuda), faults);
}

void check_shared_device(MpiJob& job, Backend& cuda, std::vector<std::string>& faults) {
  try {
    make_nccl_communicator(job.communicator(), cuda);
    faults.emplace_back("two ranks with one device are not refused");
  } catch (const Error& error) {
    if (std::string(error.what()).find("have the same device") == std::string::npos) faults.emplace_back(error.what());
  }
}

int run(int argc, char** argv) {
  const std::unique_ptr<MpiJob> job = join_mpi(argc, argv);
  const int ranks = job->communicator().size(), rank = job->communicator().rank(), devices = int(cuda_devices().size());
  if (devices == 0) {
    if (rank == 0) std::printf("nccl_contract: skipped, there is no CUDA device\n");
    return 77;
  }
  std::vector<std::string> faults;
  auto cuda = make_cuda_backend(make_cpu_backend(1), rank % devices);
  if (ranks <= devices)
    check_devices_of_their_own(*job, std::move(cuda), faults);
  else
    check_shared_device(*job, *cuda, faults);
  for (const std::string& fault : faults) std::fprintf(stderr, "%s\n", fault.c_str());
  if (rank == 0) std::printf("nccl_contract: %d ranks, %d devices\n", ranks, devices);
  return job->communicator().gather(Vector::Constant(1, double(faults.size()))).sum() > 0 ? 1 : 0;
}

}  // namespace
}  // namespace bromwich

int main(int argc, char** argv) { return bromwich::run(argc, argv); }
