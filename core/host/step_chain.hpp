#pragma once
// Linear one-step maps along a time grid of any step sizes, and their adjoint:
//
//     S_i x_i = R_i x_{i-1} + d_i,  i = 1..M,    x_0 = d_0                       (A x = d)
//     S_i^T l_i = R_{i+1}^T l_{i+1} + q_i,       l_0 = R_1^T l_1 + q_0           (A^T l = q; l_{M+1} = 0)
//
// symbol    variable                      shape    meaning
// M         StepChainProblem::steps()     1        steps; arrays have M+1 rows, row i belongs to t_i
// m         StepChainProblem::states()    1        components of a row
// S, R      StepMap                       m x m    of all steps of one kind
//           StepChainProblem::map_of      M        which map step i has, at i - 1
// P_i       S_i^{-1} R_i                  m x m    the step itself
// D_i       P_i - I                       m x m    its increment, S_i^{-1} (R_i - S_i)
//
// Steps that share their matrices share one factorization: bisection of a uniform grid leaves few sizes. All of them
// commit its rounding alike, and along M steps that adds up: P as it is rounded leaves M roundings in x and l, which no
// care in the sums can remove. Steps are therefore taken as increments, x_{i-1} + D_i x_{i-1}, and products of steps as
// (I + D)(I + D') = I + (D + D' + D D'): a small step rounds D by |D| eps, all of [0, T] by T |A| eps, whatever M.
//
// With mu_i = S_i^T l_i the adjoint is mu_i = P_{i+1}^T mu_{i+1} + q_i, (I - G) mu = q, and G is nilpotent:
//
//     substitution   from the last row to the first; serial
//     Jacobi         mu <- q + G mu, k sweeps from mu = 0: all rows at once, exact for k > M (Bartel, Schaller,
//                    Goal-oriented time adaptivity for port-Hamiltonian systems, section 5)
//     doubling       mu <- (I + G^{2^k}) mu, k = 0 .. ceil(log2(M+1)) - 1: all rows at once, exact. The entries of
//                    G^{2^k} are products of 2^k maps; windows of the grid that hold the same kinds of steps in the
//                    same order share theirs (Karp, Miller, Rosenberg, STOC 1972)
//     scan           blocks of steps: the product of each, substitution from block to block, then inside all blocks at
//                    once; exact, with m times the operations of a substitution and no more

#include "../base/error.hpp"
#include "../base/plan.hpp"
#include "../base/threads.hpp"
#include "../base/types.hpp"
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
  std::vector<Index> map_of;  ///< M, increasing time
  /// Bytes that products of maps may take (doubling, scan); what needs more is refused.
  double memory_limit = 4e9;

  Index steps() const { return Index(map_of.size()); }
  Index states() const;
  bool sparse() const;

  /// Throws Error naming the first map or step whose shape, value or number is wrong.
  void validate() const;
};

/// exact: substitution or scan, whichever is faster where the chain runs, and fits.
enum class AdjointMethod { exact, substitution, jacobi, doubling, scan };

struct AdjointChoice {
  AdjointMethod method = AdjointMethod::exact;
  Index sweeps = 1;  ///< of Jacobi, at least 1

  /// Throws Error for fewer than one.
  Index checked_sweeps() const;
};

/// A plan for one chain, made by Backend::step_chain: all maps are factorized when it is made. It works on values of
/// the host, (M+1) x m. A chain belongs to one caller at a time.
class StepChain : public Plan {
 public:
  /// A x = d. What is moved here is worked on in place.
  virtual RowMatrix solve(RowMatrix d) = 0;
  /// A^T l = q, or its approximation by Jacobi sweeps. Throws Error where sweeps < 1, or where products of maps would
  /// take more than the memory limit.
  virtual RowMatrix solve_transposed(RowMatrix q, const AdjointChoice& = {}) = 0;
  /// z_i^T r_i for i = 1..M with r_i = d_i + R_i x_{i-1} - S_i x_i, taken as d_i + (R_i - S_i) x_i - R_i (x_i -
  /// x_{i-1}): of small steps what nearly cancels is never multiplied out.
  virtual Vector weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& z) = 0;
  /// The same on a grid whose M/2 cells are halved, weighted with the adjoint inside each cell, which goes on with the
  /// given l at its end; c = 1..M/2, l is (M/2+1) x m, l_{M/2+1} = 0:
  ///     S_{2c}^T z_{2c} = q_{2c} + R_{2c+1}^T l_{c+1},    S_{2c-1}^T z_{2c-1} = q_{2c-1} + R_{2c}^T z_{2c}.
  virtual Vector locally_weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& q,
                                           const RowMatrix& l) = 0;
  bool on_host = false;  ///< steps and adjoints are computed by the host
};

/// A chain on the host. The threads have to outlive it.
std::unique_ptr<StepChain> make_step_chain(const StepChainProblem&, const HostThreads&);

/// D, S^{-1}, R and R - S of a map, written out as dense matrices, m x m. Throws Error where S is singular to rounding,
/// naming the step that has it.
struct DenseStep {
  DenseStep(const StepChainProblem&, Index map);
  Matrix increment, inverse, R, change;
};

Error singular_step(const StepChainProblem&, Index map);
/// Throws Error where products of maps would take more than the limit.
void check_products(double bytes, double limit, const char* method);

/// The step sizes of a grid, those that differ by no more than the rounding of its times taken as one.
struct StepSizes {
  Vector sizes;                                                  ///< distinct, increasing
  std::vector<Index> of;                                         ///< M: which size step i has, at i - 1
  double h(Index i) const { return sizes[of[std::size_t(i)]]; }  ///< of the step from t_i to t_{i+1}
};

/// Throws Error unless t has two points at least and is finite and increasing.
StepSizes group_steps(const Vector& t);

/// One step of x' = A x + ...: implicit Euler I - hA, I; implicit midpoint I - hA/2, I + hA/2; exponential I, e^{hA}
/// (dense).
enum class StepScheme { euler, midpoint, exponential };

StepMap step_map(StepScheme, const StepMatrix& A, double h);
/// All steps of a grid.
StepChainProblem step_chain_problem(StepScheme, const StepMatrix& A, const StepSizes&);

/// Windows of one length of a row of symbols, named so that two have the same name exactly if they hold the same
/// symbols: `of` by the place where they begin, `halves` the two names of half the length. Names count from 0 in the
/// lexicographic order of their halves.
struct WindowNames {
  std::vector<Index> of;
  std::vector<std::pair<Index, Index>> halves;
};
/// Windows of twice the length: those that begin at i with names of[i], of[i + length].
WindowNames join_windows(const std::vector<Index>& of, Index names, Index length);

}  // namespace bromwich
