#pragma once
// Affine maps along a chain of intervals, as active sets of a piecewise affine problem make them:
//
//     x_k = P x_{k-1} + F_k - G q_k,      v_k = X x_{k-1} + Q q_k,      k = 1..N,
//
// with the matrices of the map that interval k has. With S the active components of a map v is z on S and w elsewhere
// (core/galerkin/solvers.hpp), and all v >= 0 is a solution. A chain whose ends are given by a boundary condition is
// solved in blocks (core/numerics/two_point.hpp): each block as one step, the states between blocks on the host, then
// all intervals at once.
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

/// Sets of components, one after the other, each in words of 64 bits: component i is bit i % 64 of word i / 64.
using SetWords = std::vector<std::uint64_t>;
inline Index words_of_set(Index n) { return (n + 63) / 64; }
inline bool contains(const std::uint64_t* set, Index i) { return (set[i / 64] >> (i % 64) & 1) != 0; }

struct AffineMap {
  Matrix P, G, X, Q;
  SetWords active;  ///< S
};

/// Of v: the largest absolute value on the active components, and on the others.
struct ActiveSizes {
  double active = 0, inactive = 0;
  bool finite = true;  ///< of x too
};

/// A plan for one chain, made by Backend::affine_chain: the operations in this order. Nothing is solved for N = 0.
class AffineChain : public Plan {
 public:
  virtual void set_sources(const RowMatrix& F, const RowMatrix& q) = 0;
  /// The maps in use and which of them each interval has. What they point to stays until the next call.
  virtual void set_maps(const std::vector<const AffineMap*>& maps, const std::vector<int>& map_of) = 0;

  /// Phi and phi of all blocks; blocks of one map share theirs.
  struct Blocks {
    std::vector<Matrix> products;
    std::vector<const Matrix*> Phi;  ///< of each block, among the products
    RowMatrix phi;                   ///< blocks x m
  };
  virtual void condense(Index length, Blocks&) = 0;
  /// x from the first states of all blocks and the last state of all, (blocks+1) x m.
  virtual BlockEnds expand(Index length, const RowMatrix& starts) = 0;
  /// v from x.
  virtual ActiveSizes evaluate() = 0;
  /// Components that have the wrong sign, v below -active_zero on S, or below -inactive_zero elsewhere: N sets.
  virtual void wrong_signs(double active_zero, double inactive_zero, SetWords&) = 0;
  virtual void download(RowMatrix& x, RowMatrix& v) = 0;
};

/// Blocks of one map throughout share its power: which product each block has, and a block that has each product.
struct BlockProducts {
  BlockProducts(const std::vector<int>& map_of, std::size_t maps, Index length);
  std::vector<Index> product_of, block_of;
};

struct AffineChainSizes {
  Index intervals = 0, states = 0, components = 0;  ///< N, m, n
};

/// A chain on the host, whose threads have to outlive it.
std::unique_ptr<AffineChain> make_affine_chain(const AffineChainSizes&, const HostThreads&);

/// condense, states between blocks, expand, and shorter blocks where blocks do not meet. False where the boundary
/// condition does not determine the states to `least_condition`.
bool solve_chain(AffineChain&, Index intervals, const BoundaryCondition&, double least_condition);

}  // namespace bromwich
