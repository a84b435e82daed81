#pragma once

#include "core/base/types.hpp"

#include <vector>

namespace bromwich {

using Triplets = std::vector<Eigen::Triplet<double>>;

inline SparseMatrix assemble(Index rows, Index cols, const Triplets& entries) {
  SparseMatrix A(rows, cols);
  A.setFromTriplets(entries.begin(), entries.end());
  return A;
}

/// Five-point Laplacian of a G x H grid on a square with spacing 1/(G+1), plus central differences of a wind.
inline SparseMatrix grid(Index G, Index H, double diffusivity = 1, double wind = 0, double growth = 0) {
  const double dx = 1.0 / double(G + 1), c = diffusivity / (dx * dx), a = 0.5 * wind / dx;
  Triplets entries;
  for (Index i = 0; i < G; ++i)
    for (Index j = 0; j < H; ++j) {
      const Index r = i * H + j;
      entries.emplace_back(r, r, -4 * c + growth);
      if (i > 0) entries.emplace_back(r, r - H, c + a);
      if (i + 1 < G) entries.emplace_back(r, r + H, c - a);
      if (j > 0) entries.emplace_back(r, r - 1, c);
      if (j + 1 < H) entries.emplace_back(r, r + 1, c);
    }
  return assemble(G * H, G * H, entries);
}

}  // namespace bromwich
