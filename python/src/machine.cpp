#include "machine.hpp"

#include "app/backend_choice.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/method_choice.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"

#include <utility>

namespace bromwich::python {
namespace {

/// The one CUDA backend of the process, and how many threads its host has.
struct Device {
  std::mutex mutex;
  std::shared_ptr<Machine> machine;
  int threads = 0;
};

Device& device() {
  static auto* kept = new Device;  // never destroyed: the CUDA libraries may end before it does
  return *kept;
}

bool taken(const std::string& word, const Scene& scene, const Options& options, Index components, Backend& cuda) {
  if (word == "cuda") return true;
  const Index steps = options.steps > 0 ? options.steps : scene.default_steps;
  return word == "auto" && faster_on_device(cuda.traits(), cpu_traits(), scene, options.method, steps, true) &&
         fits_on_device(scene, options.method, steps, components, cuda.device());
}

}  // namespace

std::shared_ptr<Machine> machine_for(const std::string& word, const Scene& scene, const Options& options, int threads) {
  const Index components = Index(recorded_components(scene, options).size());
  Device& kept = device();
  const std::lock_guard lock(kept.mutex);
  const bool started = kept.machine && kept.threads == threads;
  if (started && taken(word, scene, options, components, *kept.machine->backend)) return kept.machine;
  auto made = std::make_shared<Machine>(
      app::choose_backend(word, scene, options, components, threads, kept.machine != nullptr));
  if (made->backend->name() == "cpu") return made;
  kept.machine = made;
  kept.threads = threads;
  return made;
}

}  // namespace bromwich::python
