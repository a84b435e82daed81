#include "app/ranks.hpp"

#include "core/base/error.hpp"
#include "core/build_info.hpp"
#include "ranks/slab_backend.hpp"

#include <fmt/format.h>

#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <thread>
#include <utility>

namespace bromwich::app {

namespace {

Job& joined() {
  static OneRank alone;
  static Job job;
  if (!job.communicator) job.communicator = &alone;
  return job;
}

// 32 bits of FNV-1a, which a double holds.
double fingerprint_of(const std::string& text) {
  std::uint32_t hash = 2166136261u;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 16777619u;
  return double(hash);
}

int cores_of_process() {
  cpu_set_t cores;
  return sched_getaffinity(0, sizeof cores, &cores) == 0 ? CPU_COUNT(&cores) : 1;
}

}  // namespace

int launched_ranks() {
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"})
    if (const char* size = std::getenv(name)) return std::max(1, std::atoi(size));
  return 1;
}

void join_job(const Job& job) { joined() = job; }
const Job& job() { return joined(); }
Communicator& ranks() { return *joined().communicator; }

void check_ranks() {
  if (launched_ranks() > 1 && ranks().size() == 1)
    throw Error("mpirun", fmt::format("started {} ranks of a program without MPI", launched_ranks()),
                "configure with -DBROMWICH_MPI=ON (libopenmpi-dev), or run it without mpirun");
  if (ranks().size() == 1) return;
  const std::string build =
      fmt::format("{} {} {} {}", build_info::version, build_info::commit, build_info::compiler, build_info::flags);
  const RowMatrix builds = ranks().gather(Vector::Constant(1, fingerprint_of(build)));
  for (int r = 1; r < ranks().size(); ++r)
    if (builds(r, 0) != builds(0, 0))
      throw Error("mpirun", fmt::format("rank {} runs another build than rank 0", r),
                  "start the same program everywhere");
}

int threads_of_rank(int asked) {
  if (ranks().size() == 1) return asked;
  int threads = asked;
  if (threads == 0 && std::getenv("OMP_NUM_THREADS")) threads = std::atoi(std::getenv("OMP_NUM_THREADS"));
  if (threads == 0) {
    const int cores = cores_of_process();
    const bool bound = cores < int(sysconf(_SC_NPROCESSORS_ONLN));
    threads = std::max(1, bound ? cores : cores / job().neighbours);
  }
  Vector fewest = Vector::Constant(1, -threads);
  ranks().maximum(fewest);
  return int(-fewest[0]);
}

std::unique_ptr<Backend> over_ranks(std::unique_ptr<Backend> backend) {
  if (ranks().size() == 1) return backend;
  if (backend->name() != "cuda") return make_slab_backend(std::move(backend), ranks());
  const std::string apart = devices_apart();
  if (!apart.empty()) throw Error("--backend", "found 'cuda' on several ranks, and " + apart, "use --backend cpu");
  auto devices = job().between_devices(dynamic_cast<const SharedMemory&>(*backend).place());
  return make_slab_backend(std::move(backend), std::move(devices));
}

std::string devices_apart() { return ranks().size() > 1 ? job().devices_apart() : ""; }

std::string& held_complaint() {
  static std::string message;
  return message;
}

}  // namespace bromwich::app
