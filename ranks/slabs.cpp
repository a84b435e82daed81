#include "ranks/slabs.hpp"

#include <algorithm>

namespace bromwich {

Index Slabs::here(Index first_row) const { return std::clamp(first_row - first(), own(), rows()); }

Slabs slabs_of(Index rows, const Communicator& communicator) {
  const Index steps = rows - 1, ranks = communicator.size(), fewest = communicator.fewest_steps() * ranks;
  Slabs slabs{{}, communicator.rank(), steps};
  if (ranks == 1 || steps < fewest) return slabs;
  Index coarsest = steps;
  while (coarsest % 2 == 0 && coarsest / 2 >= fewest) coarsest /= 2;
  const Index unit = coarsest % 2 == 0 ? 2 : 1;  // of its steps
  for (Index r = 0; r <= ranks; ++r) slabs.ends.push_back(r * (coarsest / unit) / ranks * unit * (steps / coarsest));
  return slabs;
}

bool aligned(const Slabs& fine, const Slabs& coarse) {
  if (fine.whole() || coarse.whole()) return false;
  const Index ratio = fine.steps / coarse.steps;
  for (std::size_t r = 0; r < fine.ends.size(); ++r)
    if (fine.ends[r] != ratio * coarse.ends[r]) return false;
  return true;
}

}  // namespace bromwich
