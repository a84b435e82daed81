#pragma once
// Linear one-step maps along a time grid with any step sizes, and their adjoint:
//
//     S_i x_i = R_i x_{i-1} + d_i,  i = 1..M,    x_0 = d_0                       (A x = d)
//     S_i^T l_i = R_{i+1}^T l_{i+1} + q_i,       l_0 = R_1^T l_1 + q_0           (A^T l = q; l_{M+1} = 0)
//
// symbol    variable                      shape    meaning
// M         StepChainProblem::steps()     1        steps; arrays have M+1 rows, row i belongs to t_i
// m         StepChainProblem::states()    1        components of a row
// S, R      StepMap                       m x m    of all steps of one kind
//           StepChainProblem::map_of      M        index of the map of step i, at i - 1
// P_i       S_i^{-1} R_i                  m x m    the step
// D_i       P_i - I                       m x m    its increment, S_i^{-1} (R_i - S_i)
//
// Steps with the same matrices share one factorization; bisection of a uniform grid leaves few sizes. The rounding
// error of P is then the same at every step and accumulates to M roundings in x and l, which compensated sums cannot
// remove. Steps are therefore applied as increments, x_{i-1} + D_i x_{i-1}, and products of steps are formed as
// (I + D)(I + D') = I + (D + D' + D D'). The error per small step is |D| eps, over [0, T] it is T |A| eps for any M.
//
// With mu_i = S_i^T l_i the adjoint is mu_i = P_{i+1}^T mu_{i+1} + q_i, (I - G) mu = q, and G is nilpotent:
//
//     substitution   from the last row to the first; serial
//     Jacobi         mu <- q + G mu, k sweeps from mu = 0: all rows at once, exact for k > M (Bartel, Schaller,
//                    Goal-oriented time adaptivity for port-Hamiltonian systems, section 5)
//     doubling       mu <- (I + G^{2^k}) mu, k = 0 .. ceil(log2(M+1)) - 1: all rows at once, exact. The entries of
//                    G^{2^k} are products of 2^k maps. Windows of the grid with the same sequence of step kinds share
//                    them (Karp, Miller, Rosenberg, STOC 1972)
//     scan           blocks of steps: the product of each block, substitution from block to block, then all blocks at
//                    once; exact, with m times the operations of a substitution

#include "../base/error.hpp"
#include "../base/plan.hpp"
#include "../base/threads.hpp"
#include "../base/types.hpp"
#include "bromwich/goal.hpp"
#include "step_map.hpp"

#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace bromwich {

struct StepChainProblem {
  std::vector<StepMap> maps;  ///< all dense or all sparse
  std::vector<Index> map_of;  ///< M, in order of increasing time
  /// Bytes allowed for products of maps (doubling, scan). Throws Error if a method needs more.
  double memory_limit = 4e9;

  Index steps() const { return Index(map_of.size()); }
  Index states() const;
  bool sparse() const;

  /// Throws Error that names the first map or step with a wrong shape, value or index.
  void validate() const;
};

/// A plan for one chain, made by Backend::step_chain. All maps are factorized when it is made. Works on host values,
/// (M+1) x m. One caller at a time.
class StepChain : public Plan {
 public:
  /// Solves A x = d. A moved argument is overwritten in place.
  virtual RowMatrix solve(RowMatrix d) = 0;
  /// Solves A^T l = q, or approximates it by Jacobi sweeps. Throws Error if sweeps < 1, or if products of maps exceed
  /// the memory limit.
  virtual RowMatrix solve_transposed(RowMatrix q, const AdjointChoice& = {}) = 0;
  /// z_i^T r_i for i = 1..M with the residual r_i = d_i + R_i x_{i-1} - S_i x_i. It is computed as
  /// d_i + (R_i - S_i) x_i - R_i (x_i - x_{i-1}), which avoids cancellation for small steps.
  virtual Vector weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& z) = 0;
  /// The same for a grid of M/2 cells with two steps each. The weight z is the adjoint inside each cell, continued by
  /// the given l at the end of the cell; c = 1..M/2, l is (M/2+1) x m, l_{M/2+1} = 0:
  ///     S_{2c}^T z_{2c} = q_{2c} + R_{2c+1}^T l_{c+1},    S_{2c-1}^T z_{2c-1} = q_{2c-1} + R_{2c}^T z_{2c}.
  virtual Vector locally_weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& q,
                                           const RowMatrix& l) = 0;
  bool on_host = false;  ///< steps and adjoints run on the host
};

/// A chain on the host. The threads must outlive it.
std::unique_ptr<StepChain> make_step_chain(const StepChainProblem&, const HostThreads&);

/// D, S^{-1}, R and R - S of a map as dense m x m matrices. Throws Error that names the step if S is singular to
/// rounding.
struct DenseStep {
  DenseStep(const StepChainProblem&, Index map);
  Matrix increment, inverse, R, change;
};

Error singular_step(const StepChainProblem&, Index map);
/// Throws Error if products of maps would exceed the limit.
void check_products(double bytes, double limit, const char* method);

/// The step sizes of a grid. Sizes that differ by no more than the rounding of the times count as one.
struct StepSizes {
  Vector sizes;                                                  ///< distinct, increasing
  std::vector<Index> of;                                         ///< M: index of the size of step i, at i - 1
  double h(Index i) const { return sizes[of[std::size_t(i)]]; }  ///< of the step from t_i to t_{i+1}
};

/// Throws Error unless t is finite, increasing, and has at least two points.
StepSizes group_steps(const Vector& t);

StepMap step_map(StepScheme, const StepMatrix& A, double h);
/// The maps of all steps of a grid.
StepChainProblem step_chain_problem(StepScheme, const StepMatrix& A, const StepSizes&);

/// Names of all windows of one length in a sequence of symbols. Two windows have the same name exactly if their symbols
/// agree. `of`: name by start position; `halves`: the names of the two halves of each. Names count from 0 in the
/// lexicographic order of their halves.
struct WindowNames {
  std::vector<Index> of;
  std::vector<std::pair<Index, Index>> halves;
};
/// Windows of twice the length, made of the windows at i and i + length with names of[i], of[i + length].
WindowNames join_windows(const std::vector<Index>& of, Index names, Index length);

}  // namespace bromwich
