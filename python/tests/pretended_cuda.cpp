// A shared object in the place of bromwich/_cuda.so: its two devices are backends of naive loops. Shows on machines
// without a device that backends, plans and errors pass between two shared objects.

#include "core/base/error.hpp"
#include "kernels/cuda_plugin.hpp"
#include "tests/support/reference_backend.hpp"

#include <string>

namespace bromwich {

std::vector<std::string> cuda_devices() { return {"naive loops", "more of them"}; }
bool cuda_built() { return true; }

// With three threads of the host it says which device is asked for.
std::unique_ptr<Backend> make_cuda_backend(std::unique_ptr<Backend> host, int device) {
  if (host->threads() == 3)
    throw Error("device", std::to_string(device) + " is at work", "try again", ErrorKind::device);
  return make_reference_backend();
}

CudaCeilings cuda_ceilings() { return {}; }
CudaTransformSeconds cuda_transform_seconds(Index, Index) { return {}; }

}  // namespace bromwich
