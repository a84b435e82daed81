#pragma once
// The states between chunks of time, and their correction by the ends of the chunks: core/scan/chunk_scan.hpp, for
// steps by pieces (affine_pieces.hpp). Only numbers and pointers, as there.

#include "affine_maps.hpp"

namespace bromwich::pieces {

inline constexpr double near_solution = 1e-8;  ///< relative: a delta larger than that is none of rounding
inline constexpr double least_size = 1e-6;     ///< of the largest component, as which a smaller one counts

template <Index m, Index u>
struct States {
  Index chunks = 0;
  double rounding = 0;                           ///< relative, of the march of a chunk
  double* s = nullptr;                           ///< chunks x m
  double* D = nullptr;                           ///< chunks x m x m, column by column
  Memory<u>*before = nullptr, *began = nullptr;  ///< for the next march, and of the last one
  End<m, u>* end = nullptr;
  std::uint64_t* sets = nullptr;  ///< of the march before the last correction; 0: none
  unsigned char* open = nullptr;  ///< has not settled
};

/// What is known before a chunk.
template <Index m, Index u>
struct Prefix {
  double delta[m] = {}, size[m] = {}, regular[u] = {};
  bool affine = true;  ///< all steps so far, in two marches
};

constexpr double absolute(double a) { return a < 0 ? -a : a; }
constexpr bool is_finite(double a) { return a - a == 0; }

template <Index m, Index u>
constexpr bool is_known(const End<m, u>& end) {
  bool known = end.complete;
  for (Index i = 0; i < m; ++i) known = known && is_finite(end.s[i]) && is_finite(end.size[i]);
  return known;
}

/// Relative to the sizes of the states before.
template <Index m>
constexpr double relative(const double* delta, const double* size) {
  double largest = 0, most = 1e-290;
  for (Index i = 0; i < m; ++i) largest = size[i] > largest ? size[i] : largest;
  const double least = least_size * largest > most ? least_size * largest : most;
  most = 0;
  for (Index i = 0; i < m; ++i) {
    const double part = absolute(delta[i]) / (size[i] > least ? size[i] : least);
    if (!(part <= most)) most = part;
    if (!(part == part)) return part;
  }
  return most;
}

/// Whether the last march of chunk c had the steps of the one before, or was not repeated.
template <Index m, Index u>
constexpr bool has_same_sets(const States<m, u>& g, Index c) {
  return g.open[c] == 0 || (g.end[c].complete && g.sets[c] == g.end[c].sets);
}

/// What the last march of chunk c says about those behind it, but for its delta.
template <Index m, Index u>
constexpr void pass_on(const States<m, u>& g, Index c, bool same, Prefix<m, u>& p) {
  const End<m, u>& end = g.end[c];
  p.affine = p.affine && end.complete && same;
  const bool known = is_known(end);
  for (Index i = 0; i < m; ++i) {
    const double before = absolute(g.s[c * m + i]), behind = known ? end.size[i] : 0;
    const double both = before > behind ? before : behind;
    p.size[i] = both > p.size[i] ? both : p.size[i];
  }
  for (Index i = 0; i < u; ++i)
    p.regular[i] = end.memory.regular[i] > p.regular[i] ? end.memory.regular[i] : p.regular[i];
}

/// Chunk c with what is known before it: corrects its state, opens or closes it, and moves on to the next one. Returns
/// its delta, relative; 0 where it has settled.
template <Index m, Index u>
constexpr double settle(const States<m, u>& g, Index c, Prefix<m, u>& p) {
  double size[m];
  for (Index i = 0; i < m; ++i) {
    const double own = absolute(g.s[c * m + i] + p.delta[i]);
    size[i] = own > p.size[i] ? own : p.size[i];
  }
  const double change = relative<m>(p.delta, size);
  const bool known = c == 0 || is_known(g.end[c - 1]);
  const bool settled = known && (change <= g.rounding || (p.affine && change <= near_solution));
  if (c > 0) {
    g.before[c].touching = g.end[c - 1].memory.touching;
    for (Index i = 0; i < u; ++i) g.before[c].regular[i] = p.regular[i];
  }
  bool as_before = g.began[c].touching == g.before[c].touching;
  for (Index i = 0; i < u; ++i) {
    const double regular = g.before[c].regular[i];
    as_before = as_before && regular >= g.end[c].least[i] && regular < g.end[c].below[i];
  }
  const bool same = has_same_sets(g, c);
  const bool opens = !settled || !as_before || !g.end[c].complete;
  if (settled)
    for (Index i = 0; i < m; ++i) p.delta[i] = 0;
  double next[m] = {};
  if (c + 1 < g.chunks && is_known(g.end[c])) {
    bool finite = true;
    double carried[m] = {};
    for (Index k = 0; k < m; ++k)
      for (Index i = 0; i < m; ++i) carried[i] += g.D[(c * m + k) * m + i] * p.delta[k];
    for (Index i = 0; i < m; ++i) {
      next[i] = g.end[c].s[i] - g.s[(c + 1) * m + i];
      finite = finite && is_finite(g.end[c].s[i] + carried[i]);
    }
    for (Index i = 0; i < m && finite; ++i) next[i] += carried[i];
  }
  pass_on(g, c, same, p);
  g.sets[c] = g.end[c].sets;
  g.open[c] = opens;
  for (Index i = 0; i < m; ++i) {
    if (opens) g.s[c * m + i] += p.delta[i];
    p.delta[i] = next[i];
  }
  return settled || !is_finite(change) ? 0 : change;
}

}  // namespace bromwich::pieces
