#include "core/host/affine_chain.hpp"

#include <algorithm>

namespace bromwich {

namespace {

// States between blocks. Empty if they are not determined, or if a product is too large to act as one step.
RowMatrix states_between_blocks(const AffineChain::Blocks& blocks, const BoundaryCondition& boundary,
                                double least_condition) {
  const RowMatrix none(0, blocks.phi.cols());
  for (const Matrix& product : blocks.products)
    if (!(product.cwiseAbs().maxCoeff<Eigen::PropagateNaN>() <= 1 / epsilon)) return none;
  if (!blocks.phi.allFinite()) return none;
  return solve_two_point_by_segments(blocks.Phi, blocks.phi, boundary, least_condition);
}

}  // namespace

BlockProducts::BlockProducts(const std::vector<int>& map_of, std::size_t maps, Index length) {
  const Index N = Index(map_of.size()), count = count_blocks(N, length);
  std::vector<Index> power_of(maps, -1);
  for (Index b = 0; b < count; ++b) {
    const Index first = b * length, last = std::min(N, first + length);
    const auto begin = map_of.begin() + first, end = map_of.begin() + last;
    const bool power = last - first == length && std::all_of(begin, end, [begin](int at) { return at == *begin; });
    Index product = power ? power_of[std::size_t(*begin)] : -1;
    if (product < 0) {
      product = Index(block_of.size());
      block_of.push_back(b);
      if (power) power_of[std::size_t(*begin)] = product;
    }
    product_of.push_back(product);
  }
}

bool solve_chain(AffineChain& chain, Index intervals, const BoundaryCondition& boundary, double least_condition) {
  AffineChain::Blocks blocks;
  for (const Index length : block_lengths) {
    chain.condense(length, blocks);
    const RowMatrix starts = states_between_blocks(blocks, boundary, std::max(least_condition, least_block_condition));
    if (starts.rows() == count_blocks(intervals, length) + 1 &&
        blocks_meet(starts, chain.expand(length, starts), length))
      return true;
  }
  chain.condense(1, blocks);
  const RowMatrix starts = states_between_blocks(blocks, boundary, least_condition);
  if (starts.rows() != intervals + 1) return false;
  chain.expand(1, starts);
  return true;
}

}  // namespace bromwich
