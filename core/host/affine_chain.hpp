#pragma once
// Affine maps along a chain of intervals, as they arise from the active sets of a piecewise affine problem:
//
//     x_k = P x_{k-1} + F_k - G q_k,      v_k = X x_{k-1} + Q q_k,      k = 1..N,
//
// with the matrices of the map of interval k. For the active components S of a map, v is z on S and w elsewhere
// (core/galerkin/solvers.hpp); all v >= 0 is a solution. A chain with a boundary condition is solved in blocks
// (core/numerics/two_point.hpp): each block is condensed to one step, the states between blocks are solved on the host,
// then all intervals are expanded at once.
//
// symbol    variable       shape
// N, m, n                  intervals, states, components of v and q
// P, G      AffineMap      m x m, m x n
// X, Q      AffineMap      n x m, n x n
// F, q      set_sources    N x m, N x n, row k-1 for interval k
// x, v      download       (N+1) x m, N x n

#include "../base/plan.hpp"
#include "../base/threads.hpp"
#include "../numerics/two_point.hpp"

#include <cstdint>
#include <memory>

namespace bromwich {

/// Consecutive sets of components, each in 64-bit words: component i is bit i % 64 of word i / 64.
using SetWords = std::vector<std::uint64_t>;
inline Index words_of_set(Index n) { return (n + 63) / 64; }
inline bool contains(const std::uint64_t* set, Index i) { return (set[i / 64] >> (i % 64) & 1) != 0; }

struct AffineMap {
  Matrix P, G, X, Q;
  SetWords active;  ///< S
};

/// Largest absolute value of v on the active components, and on the others.
struct ActiveSizes {
  double active = 0, inactive = 0;
  bool finite = true;  ///< x and v are finite
};

/// A plan for one chain, made by Backend::affine_chain. Call its operations in this order. With N = 0 nothing is
/// solved.
class AffineChain : public Plan {
 public:
  virtual void set_sources(const RowMatrix& F, const RowMatrix& q) = 0;
  /// The maps in use, and the index of the map of each interval. The pointers must stay valid until the next call.
  virtual void set_maps(const std::vector<const AffineMap*>& maps, const std::vector<int>& map_of) = 0;

  /// Condensed maps x -> Phi x + phi of all blocks. Blocks that repeat one map share Phi.
  struct Blocks {
    std::vector<Matrix> products;
    std::vector<const Matrix*> Phi;  ///< of each block; points into `products`
    RowMatrix phi;                   ///< blocks x m
  };
  virtual void condense(Index length, Blocks&) = 0;
  /// Computes x from `starts`, (blocks+1) x m: the first states of all blocks and the final state.
  virtual BlockEnds expand(Index length, const RowMatrix& starts) = 0;
  /// Computes v from x.
  virtual ActiveSizes evaluate() = 0;
  /// Components with the wrong sign, v < -active_zero on S or v < -inactive_zero elsewhere: N sets.
  virtual void wrong_signs(double active_zero, double inactive_zero, SetWords&) = 0;
  virtual void download(RowMatrix& x, RowMatrix& v) = 0;
};

/// Blocks that repeat one map share its power. product_of: the product of each block; block_of: a block with that
/// product.
struct BlockProducts {
  BlockProducts(const std::vector<int>& map_of, std::size_t maps, Index length);
  std::vector<Index> product_of, block_of;
};

struct AffineChainSizes {
  Index intervals = 0, states = 0, components = 0;  ///< N, m, n
};

/// A chain on the host. The threads must outlive it.
std::unique_ptr<AffineChain> make_affine_chain(const AffineChainSizes&, const HostThreads&);

/// Condenses, solves for the states between blocks, and expands; retries with shorter blocks if neighbouring blocks do
/// not agree. False if the boundary condition does not determine the states to `least_condition`.
bool solve_chain(AffineChain&, Index intervals, const BoundaryCondition&, double least_condition);

}  // namespace bromwich
