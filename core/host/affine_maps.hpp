#pragma once
// The data of affine_pieces.hpp, in sizes m, u padded by zeros: maps of steps, pieces of solutions, and what goes from
// chunk to chunk. Numbers and pointers only.

#include "../base/types.hpp"

#include <cstdint>

namespace bromwich::pieces {

inline constexpr Index most_states = 16, most_unknowns = 16, most_sources = 8;

/// Matrices by columns: a product adds columns, whose entries lie side by side in vectors of the host.
template <Index m, Index u>
struct Maps {
  double see[m][u] = {}, decay[m][m] = {}, drive[u][m] = {}, shown[u][m] = {};
  double q[u] = {}, f[m] = {}, d[m] = {};
  double of_q[most_sources][u] = {}, of_f[most_sources][m] = {}, of_d[most_sources][m] = {};
  double unit[u] = {};  ///< of Y: the matrices above and those of pieces are for a scaled problem
  double h = 0;
};

template <Index m, Index u>
struct Piece {
  double V[u][u] = {}, K[u][u] = {}, P[m][m] = {};
  unsigned active = 0;  ///< bits of S
  unsigned equal = 0;   ///< bits of the rows of K
  double rounding = 0;  ///< part of the terms, and of the largest q, up to which a value counts as zero
};

/// What a chunk takes over from the one before it beside the state (core/host/stage_steps.hpp).
template <Index n>
struct Memory {
  double regular[n] = {};  ///< largest y_i at the ends of steps without jumps
  unsigned touching = 0;
};

template <Index m, Index u>
struct End {
  double s[m] = {}, size[m] = {};
  Memory<u> memory;                     ///< `regular`: of this chunk alone
  double least[u] = {}, below[u] = {};  ///< values of `regular` before the chunk with which it takes the same steps
  std::uint64_t sets = 0;
  Index jumps = 0;
  bool complete = false;
};

/// A q outside all known pieces.
template <Index u>
struct Missed {
  double q[u] = {};
  Index chunk = -1, kind = 0, row = 0;
};

template <Index m, Index u>
struct Scene {
  const Maps<m, u>* maps = nullptr;  ///< of each kind; kind 0 is that of most steps
  const Piece<m, u>* pieces = nullptr;
  const int* known = nullptr;  ///< pieces of each kind, from kind most_pieces on
  Index most_pieces = 0;
  Index kinds = 1;                         ///< those of implicit Euler in place of kind k is kind k + kinds
  const unsigned char* kind_of = nullptr;  ///< of each row; null: all 0
  const double* sources = nullptr;         ///< J+1 rows of c_j
  Index numbers = 0;                       ///< of a row
  Index states = 0, constraints = 0;       ///< m, n of the scene
  double *x = nullptr, *y = nullptr, *impulse = nullptr;  ///< rows; the integral of y over a step may be null
  Index x_apart = 0, y_apart = 0;                         ///< from row to row
  bool substitutes_euler = false;
  unsigned rigid = 0;       ///< bits of constraints
  double moved[m][u] = {};  ///< B
};

}  // namespace bromwich::pieces
