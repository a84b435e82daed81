#include "kernels/cuda_plugin.hpp"

#include "core/seam/backend.hpp"
#include "core/seam/scene_arrays.hpp"

#include <bromwich/bromwich.hpp>

namespace bromwich {

std::string cuda_plugin_abi() {
  std::string abi = std::string(BROMWICH_VERSION) + ", compiler " + __VERSION__;
  for (const std::size_t size : {sizeof(Backend), sizeof(FusedOperations), sizeof(MarchProblem), sizeof(BackendTraits),
                                 sizeof(SceneArraysProblem)})
    abi += ", " + std::to_string(size);
  return abi;
}

}  // namespace bromwich
