// Replaces the CUDA backend in programs that load it from a shared object (kernels/cuda_plugin.hpp).

#include "core/base/error.hpp"
#include "kernels/cuda_plugin.hpp"

#include <dlfcn.h>

#include <mutex>

namespace bromwich {
namespace {

struct Loaded {
  const CudaPlugin* plugin = nullptr;
  std::string missing;
};

std::string& file() {
  static std::string name;
  return name;
}

std::string reason() {
  const char* found = dlerror();
  return found ? found : "dlopen gives no reason";
}

Loaded load() {
  if (file().empty()) return {nullptr, "this package has no CUDA backend"};
  void* library =
      dlopen(file().c_str(), RTLD_NOW | RTLD_LOCAL);  // never closed: the CUDA libraries end with the process
  if (!library)
    return {nullptr, "the CUDA backend cannot be loaded: " + reason() +
                         " (it needs libcudart, libcublas and libcufft of one CUDA version, from the system or from "
                         "NVIDIA's packages for Python)"};
  const auto entry = reinterpret_cast<CudaPluginEntry>(dlsym(library, cuda_plugin_symbol));
  if (!entry) return {nullptr, file() + " is no CUDA backend of bromwich: " + reason()};
  const CudaPlugin* plugin = entry(cuda_plugin_abi().c_str());
  if (!plugin) return {nullptr, file() + " is of another build; install both of one version"};
  return {plugin, ""};
}

const Loaded& loaded() {
  static const Loaded once = load();
  return once;
}

const CudaPlugin& required() {
  if (!loaded().plugin) throw Error("backend", "found 'cuda' but " + loaded().missing, "use cpu", ErrorKind::device);
  return *loaded().plugin;
}

}  // namespace

void set_cuda_plugin(const std::string& name) { file() = name; }
std::string cuda_plugin_missing() { return loaded().missing; }

std::vector<std::string> cuda_devices() {
  return loaded().plugin ? loaded().plugin->devices() : std::vector<std::string>();
}
bool cuda_built() { return !file().empty(); }

std::unique_ptr<Backend> make_cuda_backend(std::unique_ptr<Backend> host, int device) {
  return required().make(std::move(host), device);
}
CudaCeilings cuda_ceilings() { return required().ceilings(); }
CudaTransformSeconds cuda_transform_seconds(Index n, Index rows) { return required().transform_seconds(n, rows); }

}  // namespace bromwich
