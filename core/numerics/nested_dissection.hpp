#pragma once
// An order of elimination by nested dissection, from the graph of a matrix alone.
//
// A piece of the graph is divided by a separator, its parts in the same way, and a separator comes behind its parts
// (George, SIAM J. Numer. Anal. 10, 1973). Separators are found along level sets of differences of distances: with a
// and b two of four vertices far from each other, d(v, a) - d(v, b) grows from the one to the other, and on a grid with
// corners a and b its level sets are straight lines.

#include "../base/types.hpp"

#include <vector>

namespace bromwich {

/// Neighbours of vertex v: neighbour[start[v]] .. neighbour[start[v + 1] - 1]. Symmetric, without loops.
struct Graph {
  std::vector<int> start, neighbour;

  int vertices() const { return int(start.size()) - 1; }
};

/// All vertices in the order of their elimination.
std::vector<int> nested_dissection(const Graph&);

}  // namespace bromwich
