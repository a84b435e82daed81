#pragma once
// The scan over chunks of time on a device (core/host/chunk_states.hpp), in three kernels: links of 16 chunks each; the
// states before all links, by one block; the chunks of each link by a thread, which corrects their states and lists
// those that have not settled. They follow the marches without waiting for the host, and do nothing where a step was
// outside all pieces.

#include "core/host/chunk_states.hpp"

#include <algorithm>

namespace bromwich::cuda::chunks {

using pieces::Missed;
using pieces::Prefix;
using pieces::Scene;
using pieces::States;

inline constexpr int chunks_of_link = 16;
inline constexpr int links_side_by_side = 32;  // in the block that joins them

/// What the marches and the scan have found. `largest`: the bits of a positive double.
struct Found {
  int open = 0, misses = 0, unknown = 0;
  unsigned long long largest = 0, jumps = 0;
};

/// The map from delta before some chunks to delta behind them, and what they add to a Prefix.
template <Index m, Index u>
struct Link {
  double P[m][m], delta[m], size[m], regular[u];  // P column by column
  bool affine;
};

template <Index m, Index u>
struct Work {
  Scene<m, u> scene;
  States<m, u> states;
  Index steps;
  int *open_list, *missed_list;
  Missed<u>* missed;
  Found* found;
  Link<m, u>*links, *joined;
  Prefix<m, u>* before_link;
};

// delta <- P delta; P column by column.
template <Index m>
__device__ void times(const double* P, double* delta) {
  double sum[m] = {};
  for (int k = 0; k < m; ++k)
    for (int i = 0; i < m; ++i) sum[i] += P[k * m + i] * delta[k];
  for (int i = 0; i < m; ++i) delta[i] = sum[i];
}

// Threads 0 .. m - 1 of a link have a column of P, thread m the rest.
template <Index m, Index u>
__global__ void link_chunks(const __grid_constant__ Work<m, u> w, int links) {
  constexpr int lanes = m + 1;
  const int at = int(blockIdx.x * blockDim.x + threadIdx.x), l = at / lanes, lane = at % lanes;
  if (l >= links || w.found->misses > 0) return;
  const States<m, u>& g = w.states;
  const Index first = Index(l) * chunks_of_link, last = min(first + chunks_of_link, g.chunks);
  Link<m, u>& link = w.links[l];
  double v[m] = {};
  if (lane < m) v[lane] = 1;
  Prefix<m, u> rest;
  for (Index c = first; c < last; ++c) {
    const bool known = is_known(g.end[c]);
    times<m>(g.D + c * m * m, v);
    bool finite = known;
    for (int i = 0; i < m; ++i) finite = finite && pieces::is_finite(v[i]);
    if (!finite)
      for (int i = 0; i < m; ++i) v[i] = 0;
    if (lane < m) continue;
    for (int i = 0; i < m && known && c + 1 < g.chunks; ++i) v[i] += g.end[c].s[i] - g.s[(c + 1) * m + i];
    pieces::pass_on(g, c, pieces::has_same_sets(g, c), rest);
  }
  if (lane < m) {
    for (int i = 0; i < m; ++i) link.P[lane][i] = v[i];
    return;
  }
  for (int i = 0; i < m; ++i) link.delta[i] = v[i], link.size[i] = rest.size[i];
  for (int i = 0; i < u; ++i) link.regular[i] = rest.regular[i];
  link.affine = rest.affine;
}

// What a link makes of the prefix before it.
template <Index m, Index u>
__device__ void pass_link(const Link<m, u>& link, Prefix<m, u>& p) {
  times<m>(&link.P[0][0], p.delta);
  for (int i = 0; i < m; ++i) {
    p.delta[i] += link.delta[i];
    p.size[i] = fmax(p.size[i], link.size[i]);
  }
  for (int i = 0; i < u; ++i) p.regular[i] = fmax(p.regular[i], link.regular[i]);
  p.affine = p.affine && link.affine;
}

// One block: the prefix before every link.
template <Index m, Index u>
__global__ void __launch_bounds__(links_side_by_side*(m + 1))
    join_links(const __grid_constant__ Work<m, u> w, int links) {
  constexpr int lanes = m + 1;
  if (w.found->misses > 0) return;
  const int at = int(threadIdx.x), r = at / lanes, lane = at % lanes;
  const int each = (links + links_side_by_side - 1) / links_side_by_side;
  const int first = min(r * each, links), last = min(first + each, links);
  if (r < links_side_by_side) {
    double v[m] = {};
    if (lane < m) v[lane] = 1;
    Prefix<m, u> rest;
    if (lane < m)
      for (int l = first; l < last; ++l) times<m>(&w.links[l].P[0][0], v);
    else
      for (int l = first; l < last; ++l) pass_link(w.links[l], rest);
    Link<m, u>& to = w.joined[r];
    for (int i = 0; i < m && lane < m; ++i) to.P[lane][i] = v[i];
    if (lane == m) {
      for (int i = 0; i < m; ++i) to.delta[i] = rest.delta[i], to.size[i] = rest.size[i];
      for (int i = 0; i < u; ++i) to.regular[i] = rest.regular[i];
      to.affine = rest.affine;
    }
  }
  __syncthreads();
  __shared__ Prefix<m, u> before[links_side_by_side];
  if (at == 0) {
    Prefix<m, u> p;
    for (int i = 0; i < u; ++i) p.regular[i] = w.states.before[0].regular[i];
    for (int k = 0; k < links_side_by_side; ++k) {
      before[k] = p;
      pass_link(w.joined[k], p);
    }
  }
  __syncthreads();
  if (r >= links_side_by_side || lane != 0) return;
  Prefix<m, u> p = before[r];
  for (int l = first; l < last; ++l) {
    w.before_link[l] = p;
    pass_link(w.links[l], p);
  }
}

template <Index m, Index u>
__global__ void correct_chunks(const __grid_constant__ Work<m, u> w, int links) {
  const int l = int(blockIdx.x * blockDim.x + threadIdx.x);
  if (l >= links || w.found->misses > 0) return;
  const States<m, u>& g = w.states;
  const Index first = Index(l) * chunks_of_link, last = min(first + chunks_of_link, g.chunks);
  Prefix<m, u> p = w.before_link[l];
  double largest = 0;
  unsigned long long jumps = 0;
  for (Index c = first; c < last; ++c) {
    largest = fmax(largest, pieces::settle(g, c, p));
    jumps += g.end[c].jumps;
    if (!is_known(g.end[c])) atomicAdd(&w.found->unknown, 1);
    if (g.open[c]) w.open_list[atomicAdd(&w.found->open, 1)] = int(c);
  }
  if (jumps > 0) atomicAdd(&w.found->jumps, jumps);
  if (largest > 0) atomicMax(&w.found->largest, static_cast<unsigned long long>(__double_as_longlong(largest)));
}

template <Index m, Index u>
__global__ void begin_chunks(const __grid_constant__ Work<m, u> w, const double* s0, pieces::Memory<u> memory) {
  const Index c = Index(blockIdx.x) * blockDim.x + threadIdx.x;
  const States<m, u>& g = w.states;
  if (c >= g.chunks) return;
  for (int i = 0; i < m; ++i) g.s[c * m + i] = s0[i];
  g.before[c] = memory;
  g.sets[c] = 0;
  g.open[c] = 1;
}

}  // namespace bromwich::cuda::chunks
