// A shared object in the place of bromwich/_cuda.so: its two devices are backends of naive loops. Shows on machines
// without a device that backends, plans and errors pass between two shared objects. The number of threads chooses what
// they do. With three threads they fail, and the error names the device. With two they report expensive single steps,
// as devices do. With four threads their arrays are not in reach of the host, and have operations on rows. Otherwise
// they are like a processor.

#include "core/base/error.hpp"
#include "kernels/cuda_plugin.hpp"
#include "tests/support/reference_backend.hpp"
#include "tests/support/row_ranks.hpp"

#include <string>

namespace bromwich {

std::vector<std::string> cuda_devices() { return {"naive loops", "more of them"}; }
bool cuda_built() { return true; }

std::unique_ptr<Backend> make_cuda_backend(std::unique_ptr<Backend> host, int device) {
  if (host->threads() == 3)
    throw Error("device", std::to_string(device) + " is at work", "try again", ErrorKind::device);
  if (host->threads() == 4) return make_row_backend();
  BackendTraits traits;
  traits.one_at_a_time = host->threads() != 2;
  traits.fewest_values = 1000;
  return make_reference_backend(traits);
}

CudaCeilings cuda_ceilings() { return {}; }
CudaTransformSeconds cuda_transform_seconds(Index, Index) { return {}; }

}  // namespace bromwich
