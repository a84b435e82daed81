#include "core/slabs/slabs.hpp"

#include <algorithm>

namespace bromwich {

Index Slabs::here(Index first_row) const { return std::clamp(first_row - first(), own(), rows()); }

Slabs slabs_of(Index rows, const Communicator& communicator) {
  const Index steps = rows - 1, ranks = communicator.size(), fewest = fewest_steps_of_a_slab * ranks;
  Slabs slabs{{}, communicator.rank(), steps};
  if (ranks == 1 || steps < fewest) return slabs;
  Index coarsest = steps;
  while (coarsest % 2 == 0 && coarsest / 2 >= fewest) coarsest /= 2;
  for (Index r = 0; r <= ranks; ++r) slabs.ends.push_back(r * coarsest / ranks * (steps / coarsest));
  return slabs;
}

}  // namespace bromwich
