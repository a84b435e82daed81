#include "app/backend_choice.hpp"

#include "app/ranks.hpp"
#include "app/text.hpp"
#include "core/base/error.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/method_choice.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"

#include <fmt/format.h>

#include <mutex>
#include <utility>
#include <vector>

namespace bromwich::app {

std::unique_ptr<Backend> choose_backend(const std::string& word, const Scene& scene, const Options& options,
                                        Index components, int threads, bool device_started,
                                        std::optional<int> device_wanted) {
  const Index steps = steps_of(scene, options);
  if (word == "cpu" || (word == "auto" &&
                        (!cuda_built() || !devices_apart().empty() ||
                         !faster_on_device(cuda_traits(), cpu_traits(), scene, options.method, steps, device_started) ||
                         cuda_devices().empty())))
    return make_cpu_backend(threads);
  if (word != "auto" && word != "cuda")
    throw Error("--backend", "found '" + word + "'" + suggestion(word, {"auto", "cpu", "cuda"}),
                "use auto, cpu or cuda");
  if (!cuda_built()) throw Error("--backend", "found 'cuda' but this build has no CUDA backend", "use --backend cpu");
  if (cuda_devices().empty())
    throw Error("--backend", "found 'cuda' but no CUDA device", "use --backend cpu, or see what nvidia-smi says");
  auto cuda = make_cuda_backend(make_cpu_backend(threads), device_number(device_wanted, job().number_here));
  if (word == "cuda") return cuda;
  DeviceInfo device = cuda->device();
  device.memory *= ranks().size();
  Vector misfits = Vector::Constant(1, fits_on_device(scene, options.method, steps, components, device) ? 0 : 1);
  ranks().maximum(misfits);  // all of them take devices, or none
  return misfits[0] > 0 ? make_cpu_backend(threads) : std::move(cuda);
}

namespace {

struct KeptBackends {
  std::mutex mutex;
  std::vector<std::shared_ptr<Backend>> all;
};

}  // namespace

int device_number(std::optional<int> given, int number_here) {
  const int devices = int(cuda_devices().size());
  if (!given) return devices > 0 ? number_here % devices : 0;
  if (*given < 0 || *given >= devices)
    throw Error("device",
                fmt::format("found {}, and there {}", *given,
                            devices == 0   ? "is no CUDA device"
                            : devices == 1 ? "is one CUDA device"
                                           : fmt::format("are {} CUDA devices", devices)),
                devices == 0   ? "use the backend cpu"
                : devices == 1 ? "give 0"
                               : fmt::format("give 0 to {}", devices - 1),
                ErrorKind::device);
  return *given;
}

MakeBackend backends_beside(const Backend& backend, std::optional<int> device) {
  return [on_device = backend.name() == "cuda", device,
          kept = std::make_shared<KeptBackends>()]() -> std::shared_ptr<Backend> {
    const std::lock_guard lock(kept->mutex);
    for (const std::shared_ptr<Backend>& one : kept->all)
      if (one.use_count() == 1) return one;
    kept->all.push_back(on_device ? make_cuda_backend(make_cpu_backend(1), device_number(device, job().number_here))
                                  : make_cpu_backend(1));
    return kept->all.back();
  };
}

std::string backend_list() {
  if (!cuda_built()) return "cpu (cuda is not built in)";
  const auto devices = cuda_devices();
  if (devices.empty()) return "cpu (cuda finds no device)";
  return "cpu, cuda: " + join(devices);
}

}  // namespace bromwich::app
