// Chunks of time of scenes with up to 4 states, padded.

#include "kernels/chunk_march.cuh"

namespace bromwich::cuda {

template std::unique_ptr<ChunkMarch> make_chunks<4, true>(const Device&, const ChunkMarchProblem&);
template std::unique_ptr<ChunkMarch> make_chunks<4, false>(const Device&, const ChunkMarchProblem&);

}  // namespace bromwich::cuda
