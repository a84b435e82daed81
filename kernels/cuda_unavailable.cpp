// Replaces the CUDA backend in builds without nvcc.

#include "core/base/error.hpp"
#include "kernels/ceilings.hpp"
#include "kernels/cuda_backend.hpp"

namespace bromwich {

std::vector<std::string> cuda_devices() { return {}; }
bool cuda_built() { return false; }

namespace {

[[noreturn]] void refuse() {
  throw Error("backend", "found 'cuda' but this build has no CUDA backend",
              "configure with -DBROMWICH_CUDA=ON where nvcc is installed, or use cpu");
}

}  // namespace

std::unique_ptr<Backend> make_cuda_backend(std::unique_ptr<Backend>, int) { refuse(); }
CudaCeilings cuda_ceilings() { refuse(); }
CudaTransformSeconds cuda_transform_seconds(Index, Index) { refuse(); }

}  // namespace bromwich
