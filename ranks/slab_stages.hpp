#pragma once
// Arrays with two stages in each step (StageOperations) whose rows are divided among ranks. A slab has both stages of
// its steps (Slabs), so that these operations need no message; only the convolution carries a state.

#include "slab_array.hpp"

namespace bromwich {

/// `by_host` takes the arrays whose grids are not divided at the same points.
StageOperations slab_stages(const RankedBackend&, const StageOperations& by_host);

}  // namespace bromwich
