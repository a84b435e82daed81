// Chunks of time of scenes with up to 8 states, padded.

#include "kernels/chunk_march.cuh"

namespace bromwich::cuda {

template std::unique_ptr<ChunkMarch> make_chunks<8, true>(const Device&, const ChunkMarchProblem&);
template std::unique_ptr<ChunkMarch> make_chunks<8, false>(const Device&, const ChunkMarchProblem&);

}  // namespace bromwich::cuda
