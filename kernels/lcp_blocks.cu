// Dense complementarity problems, a block for each: more than 64 unknowns, semidefinite M, and rows that lcp_lanes.cu
// leaves.

#include "kernels/launch.cuh"
#include "kernels/lcp_block.cuh"

#include <algorithm>

namespace bromwich::cuda {

namespace {

// Blocks take every gridDim.x-th problem. eps = 0: M is no semidefinite one.
__global__ void __launch_bounds__(BlockProblem::most_threads)
    solve_by_blocks(LcpArrays arrays, DenseProblems m, int first, int rows, LeftRows left, double eps, int room,
                    double* slabs, OutcomeTarget target) {
  extern __shared__ double shared[];
  let_next_begin();
  await_previous();
  Outcomes outcomes(target);
  BlockProblem problem(m, shared, room, slabs + long(blockIdx.x) * m.n * (m.n + 1));
  const int count = left.rows ? *left.count : rows - first;
  for (int p = blockIdx.x; p < count; p += gridDim.x) {
    const int j = left.rows ? left.rows[p] : first + p;
    const long at = long(j) * arrays.stride;
    problem.load(arrays, at);
    const bool found = eps > 0 ? problem.least_norm(eps) : problem.newton(0) && (!m.least || problem.positive);
    double change = 0, magnitude = 0;
    for (int i = threadIdx.x; i < m.n; i += blockDim.x) {
      const double y = problem.active[i] ? problem.value[i] : 0;
      problem.value[i] = y <= 0 ? 0 : m.column_scale[i] * y;  // keeps a NaN
      change = larger(fabs(problem.value[i] - arrays.y[at + i]), change);
      magnitude = larger(fabs(problem.value[i]), magnitude);
    }
    change = problem.largest_of_block(change), magnitude = problem.largest_of_block(magnitude);
    const bool solved = found && isfinite(problem.size) && isfinite(change) && isfinite(magnitude);
    if (solved)
      for (int i = threadIdx.x; i < m.n; i += blockDim.x) arrays.y[at + i] = problem.value[i];
    if (threadIdx.x == 0) {
      if (solved)
        outcomes.solved(j, problem.sweeps, change, magnitude);
      else
        outcomes.unsolved(j, problem.sweeps);
    }
    __syncthreads();
  }
  outcomes.finish<true>();
}

}  // namespace

BlockLcp::BlockLcp(const Device& device, Index n, Index rows, double largest)
    : device_(device), eps_(1e-3 * largest), threads_(n <= largest_in_lanes ? 128 : BlockProblem::most_threads) {
  const Index most = Index(device.shared_memory() / sizeof(double)) - BlockProblem::beside(n);
  room_ = int(std::min(n * (n + 1), most));
  shared_ = sizeof(double) * std::size_t(room_ + BlockProblem::beside(n));
  check(cudaFuncSetAttribute(solve_by_blocks, cudaFuncAttributeMaxDynamicSharedMemorySize, int(device.shared_memory())),
        "preparing the complementarity problems");
  int of_each = 1;
  check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&of_each, solve_by_blocks, int(threads_), shared_),
        "preparing the complementarity problems");
  blocks_ = unsigned(std::min(rows, Index(of_each) * device.multiprocessors()));
  if (n * (n + 1) > room_) slabs_ = Memory<double>(device, std::size_t(blocks_) * std::size_t(n * (n + 1)));
}

void BlockLcp::solve(const LcpArrays& arrays, const DenseProblems& m, int first, int rows, LeftRows left,
                     const OutcomeTarget& target) {
  const unsigned blocks = std::min(blocks_, unsigned(rows - first));
  follow(device_, solve_by_blocks, {blocks, threads_, shared_}, "starting the complementarity problems", arrays, m,
         first, rows, left, eps_, room_, slabs_.data(), target);
}

}  // namespace bromwich::cuda
