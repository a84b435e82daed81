#include "machine.hpp"

#include "app/backend_choice.hpp"
#include "core/base/error.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/method_choice.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_plugin.hpp"
#include "ranks/slab_backend.hpp"

#include <exception>
#include <map>
#include <string>
#include <utility>

namespace bromwich::python {
namespace {

/// A backend and how many threads its host has.
struct KeptMachine {
  std::shared_ptr<Machine> machine;
  int threads = 0;

  bool fits(int asked) const { return machine && threads == asked; }
};

struct KeptMachines {
  std::mutex mutex;
  KeptMachine cpu;
  std::map<int, KeptMachine> cuda;  ///< by the number of the device
};

KeptMachines& kept_machines() {
  static auto* kept = new KeptMachines;  // never destroyed: the CUDA libraries may end before it does
  return *kept;
}

bool idle(Machine& machine) {
  const std::unique_lock lock(machine.busy, std::try_to_lock);
  return lock.owns_lock();
}

bool stays_on_host(const std::string& word, const Scene& scene, const Options& options, bool started) {
  if (word != "auto") return word == "cpu";
  const Index steps = steps_of(scene, options);
  return !cuda_built() || !faster_on_device(cuda_traits(), cpu_traits(), scene, options.method, steps, started);
}

std::shared_ptr<Machine> on_host(KeptMachines& kept, int threads, bool own) {
  if (own) return std::make_shared<Machine>(make_cpu_backend(threads));
  if (!kept.cpu.fits(threads) || !idle(*kept.cpu.machine))
    kept.cpu = {std::make_shared<Machine>(make_cpu_backend(threads)), threads};
  return kept.cpu.machine;
}

bool takes(const std::string& word, const Scene& scene, const Options& options, Index components, Backend& cuda) {
  const Index steps = steps_of(scene, options);
  return word == "cuda" || fits_on_device(scene, options.method, steps, components, cuda.device());
}

/// The processor, or the device of this rank where devices are asked for. All ranks throw where one does: the others
/// would wait for it.
std::unique_ptr<Backend> backend_of_rank(Communicator& ranks, const Wanted& wanted, const Scene& scene,
                                         const Options& options) {
  const auto& [word, given, number_here, threads] = wanted;
  if (word == "auto" || word == "cpu") {
    if (given)
      throw Error("device", "is given on " + std::to_string(ranks.size()) + " ranks with backend '" + word + "'",
                  "use the backend cuda, or leave it out");
    return make_cpu_backend(threads);
  }
  std::unique_ptr<Backend> made;
  std::exception_ptr error;
  try {
    if (word == "cuda" && !cuda_plugin_missing().empty())
      throw Error("backend", "found 'cuda' but " + cuda_plugin_missing(), "use cpu", ErrorKind::device);
    const Index components = Index(recorded_components(scene, options).size());
    made = app::choose_backend(word, scene, options, components, threads, true, app::device_number(given, number_here));
  } catch (const Error&) {
    error = std::current_exception();
  }
  Vector failed = Vector::Constant(1, error ? 1 : 0);
  ranks.maximum(failed);
  if (error) std::rethrow_exception(error);
  if (failed[0] > 0)
    throw Error("backend", "found '" + word + "', which another rank does not have", "see what it reports, or use cpu",
                ErrorKind::device);
  return made;
}

}  // namespace

namespace {

std::shared_ptr<Machine> find_machine(const Wanted& wanted, const Scene& scene, const Options& options, bool own) {
  const auto& [word, given, number_here, threads] = wanted;
  KeptMachines& kept = kept_machines();
  const std::lock_guard lock(kept.mutex);
  if (word == "cuda" && !cuda_plugin_missing().empty())
    throw Error("backend", "found 'cuda' but " + cuda_plugin_missing(), "use cpu", ErrorKind::device);
  if (given) app::device_number(given, number_here);
  if (stays_on_host(word, scene, options, !kept.cuda.empty())) return on_host(kept, threads, own);
  const Index components = Index(recorded_components(scene, options).size());
  const int device = app::device_number(given, number_here);
  if (const auto found = kept.cuda.find(device);
      found != kept.cuda.end() && found->second.fits(threads) && (word == "auto" || word == "cuda")) {
    const std::shared_ptr<Machine>& machine = found->second.machine;
    if (takes(word, scene, options, components, *machine->backend)) return machine;
    machine->forget();
    return takes(word, scene, options, components, *machine->backend) ? machine : on_host(kept, threads, own);
  }
  auto made = std::make_shared<Machine>(
      app::choose_backend(word, scene, options, components, threads, !kept.cuda.empty(), device));
  made->device = device;
  if (made->backend->name() == "cuda") kept.cuda[device] = {made, threads};
  return made;
}

}  // namespace

std::shared_ptr<Machine> machine_for(const Wanted& wanted, const Scene& scene, const Options& options, bool own,
                                     bool keeps) {
  auto machine = find_machine(wanted, scene, options, own);
  if (!keeps) machine->forget();
  return machine;
}

std::shared_ptr<Machine> machine_on_ranks(std::shared_ptr<Communicator> ranks, const Wanted& wanted, const Scene& scene,
                                          const Options& options) {
  auto divided = make_slab_backend(backend_of_rank(*ranks, wanted, scene, options), *ranks);
  return std::make_shared<Machine>(std::move(divided), std::move(ranks));
}

std::shared_ptr<Machine> machine_of_result(const std::shared_ptr<Machine>& machine, const Scene& scene,
                                           const Options& options, int threads) {
  return machine->ranks ? machine_for({"cpu", {}, 0, threads}, scene, options) : machine;
}

}  // namespace bromwich::python
