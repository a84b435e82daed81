// The communicator of NCCL, under mpirun: its contract where each rank has a device of its own, and a divided solve;
// its refusal where two ranks share one. Exit code 77: no device.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/solve/solver.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"
#include "kernels/nccl_communicator.hpp"
#include "mpi/mpi_job.hpp"
#include "ranks/slab_backend.hpp"
#include "tests/support/communicator_contract.hpp"

#include <algorithm>
#include <cstdio>
#include <string>
#include <utility>

namespace bromwich {
namespace {

// Sweeps end at a change of 1e-14; transforms of the device and of the host round otherwise, and sums of carries too.
constexpr double same_solution = 1e-11;

struct Case {
  const char* scene;
  double Q;
  Method method;
  Index steps;
};

// The graphs of cycles, walks through many modes, grids that all ranks hold, ends of slabs that no coarse grid has.
constexpr Case cases[] = {{"signorini", 15, Method::contour, 1024},     {"signorini", 63, Method::multigrid, 1536},
                          {"signorini3d", 15, Method::multigrid, 1024}, {"signorini3d", 31, Method::multigrid, 512},
                          {"signorini3d", 15, Method::contour, 500},    {"dlcp-small", 0, Method::contour, 512},
                          {"contact", 7, Method::dual, 1024},           {"contact", 15, Method::dual, 768}};

void check_solves(Backend& divided, std::vector<std::string>& faults) {
  const auto host = make_cpu_backend(2);
  for (const Case& one : cases) {
    const Scene scene = make_scene(one.scene, one.Q > 0 ? ParameterValues{{"Q", one.Q}} : ParameterValues{});
    Options options;
    options.method = one.method;
    options.steps = one.steps;
    options.iteration_tolerance = 1e-14;
    const Result of_host = solve(scene, *host, options);
    const RowMatrix& expected = of_host.y;
    Solver solver(scene, divided, options);
    for (int again = 0; again < 2; ++again) {
      const Result found = solver.solve();
      const std::string name = std::string(one.scene) + " by " + to_string(one.method);
      if (found.status != Status::solved) faults.push_back(name + " ends: " + found.reason);
      const double apart = (found.y - expected).cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
      if (!(apart <= same_solution)) faults.push_back(name + " is apart by " + std::to_string(apart * 1e12) + "e-12");
      if (!(found.residual <= std::max(1e-12, 2 * of_host.residual))) faults.push_back(name + " has another residual");
    }
  }
}

SharedMemory::Place place_of(Backend& cuda) { return dynamic_cast<const SharedMemory&>(cuda).place(); }

void check_devices_of_their_own(MpiJob& job, std::unique_ptr<Backend> cuda, std::vector<std::string>& faults) {
  const auto ranks = make_nccl_communicator(job.communicator(), place_of(*cuda));
  faults = faults_of(*ranks);
  for (const std::string& fault : faults_of_rows(*ranks, *cuda)) faults.push_back(fault);
  check_solves(*make_slab_backend(std::move(cuda), *ranks), faults);
}

// Refused; by way of the host such ranks can be divided all the same.
void check_shared_device(MpiJob& job, std::unique_ptr<Backend> cuda, std::vector<std::string>& faults) {
  try {
    make_nccl_communicator(job.communicator(), place_of(*cuda));
    faults.emplace_back("two ranks with one device are not refused");
  } catch (const Error& error) {
    if (std::string(error.what()).find("have the same device") == std::string::npos) faults.emplace_back(error.what());
  }
  check_solves(*make_slab_backend(std::move(cuda), job.communicator()), faults);
}

int run(int argc, char** argv) {
  const std::unique_ptr<MpiJob> job = join_mpi(argc, argv);
  const int ranks = job->communicator().size(), rank = job->communicator().rank(), devices = int(cuda_devices().size());
  if (devices == 0) {
    if (rank == 0) std::printf("nccl_contract: skipped, there is no CUDA device\n");
    return 77;
  }
  std::vector<std::string> faults;
  auto cuda = make_cuda_backend(make_cpu_backend(1), job->number_here() % devices);
  if (ranks <= devices)
    check_devices_of_their_own(*job, std::move(cuda), faults);
  else
    check_shared_device(*job, std::move(cuda), faults);
  for (const std::string& fault : faults) std::fprintf(stderr, "%s\n", fault.c_str());
  if (rank == 0) std::printf("nccl_contract: %d ranks, %d devices\n", ranks, devices);
  return job->communicator().gather(Vector::Constant(1, double(faults.size()))).sum() > 0 ? 1 : 0;
}

}  // namespace
}  // namespace bromwich

int main(int argc, char** argv) { return bromwich::run(argc, argv); }
