#pragma once
// The block triangular form of a square sparse matrix.

#include "circuits/rows.hpp"

#include <utility>
#include <vector>

namespace bromwich::circuits {

/// (equation, unknown), as many of both.
using Block = std::vector<std::pair<Index, Index>>;

struct BlockOrder {
  std::vector<Block> blocks;  ///< each depends on those before it alone
  Index unmatched = -1;       ///< an unknown that no equation is left for: the matrix is singular
};

BlockOrder block_order(const Rows&);

}  // namespace bromwich::circuits
