#pragma once

#include "../base/types.hpp"

#include <algorithm>
#include <vector>

namespace bromwich {

/// The connected components of a graph with the vertices 0 .. n-1, each in increasing order. joined(i, j): whether
/// there is an edge. reach(i, j): j is new, and is reached from i; the first vertex of a component is not reached.
template <typename Joined, typename Reach>
std::vector<std::vector<Index>> connected_components(Index n, const Joined& joined, const Reach& reach) {
  std::vector<std::vector<Index>> all;
  std::vector<char> seen(std::size_t(n), 0);
  for (Index root = 0; root < n; ++root) {
    if (seen[std::size_t(root)]) continue;
    seen[std::size_t(root)] = 1;
    std::vector<Index>& members = all.emplace_back(1, root);
    for (std::size_t k = 0; k < members.size(); ++k)
      for (Index j = 0; j < n; ++j) {
        const Index i = members[k];
        if (seen[std::size_t(j)] || !joined(i, j)) continue;
        seen[std::size_t(j)] = 1;
        reach(i, j);
        members.push_back(j);
      }
    std::sort(members.begin(), members.end());
  }
  return all;
}

}  // namespace bromwich
