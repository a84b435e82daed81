// Chunks of time: the kernels of a problem (kernels/chunk_march.cuh).

#include "core/seam/chunk_packing.hpp"
#include "kernels/parts.hpp"

namespace bromwich::cuda {

std::unique_ptr<ChunkMarch> make_chunk_march(const Device& device, const ChunkMarchProblem& p) {
  if (!fits_chunk_march(p)) return nullptr;
  return pieces::with_size(p.m, [&](auto m) {
    constexpr Index states = decltype(m)::is;
    return p.continuous ? make_chunks<states, true>(device, p) : make_chunks<states, false>(device, p);
  });
}

}  // namespace bromwich::cuda
