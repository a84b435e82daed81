#pragma once
// The inverse of a problem in time. With K the convolution of implicit Euler on a grid, V = (M delta + K)^{-1} in the
// ring of causal convolutions, and r the terms of w without y,
//
//     0 <= w  ⊥  y = V w + s >= 0,   s = -V r.
//
// with V^(z) = (M + N (zI - A)^{-1} B)^{-1}. This is a problem like the primal one, with a matrix P in place of M and V
// - P delta in place of K, and so are its sweeps:
//
//     w <- SOL(P + d I, s + (V - P delta) w - d w),
//
// for P = 0 the projected Richardson sweep w <- max(0, w - (V w + s)/d), and for d = 0 and a multiple P of V_0 a sweep
// by blocks.
//
// V is the convolution quadrature by implicit Euler, at z = (1 - zeta)/h, or by Radau IIA with two stages
// (core/dual/stage_weights.hpp). The problem of the stages is that of core/host/stage_march.hpp, and has the same
// solution; arrays then have 2J + 1 rows, those of both stages of each step.
//
// Kronecker sums: one scalar inverse per sine mode, as a short sum of exponentials (core/kernel/transfer_fit.hpp).
// Sparse and supplied dynamics: a fit of the n x n entries with poles that are shared, from shifted solves.
// Dense dynamics, implicit Euler: the step with the roles of y and w exchanged. With R = (I - hA)^{-1}, W_0 = h N R B,
// V_0 = (M + W_0)^{-1},
//
//     y_j = V_0 (w_j - N R x_{j-1}),   x_j = (R - h R B V_0 N R) x_{j-1} + h R B V_0 w_j.

#include "../kernel/discrete_problem.hpp"
#include "../kernel/transfer_fit.hpp"
#include "../kernel/weights.hpp"
#include "stage_weights.hpp"
#include "sweep_choice.hpp"

#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace bromwich {

struct DualWeights {
  LcpMatrix P;       ///< (1 + alpha) V_0 for dense dynamics; 0, tridiagonal, for others
  double shift = 0;  ///< d
  /// Divisors of the sweeps of a cycle in order, the last one for the sweep after the correction; empty: d for all.
  std::vector<double> shifts = {};
  std::vector<StageDivisors> stage_divisors = {};             ///< instead of them with two stages
  SharedWeights weights;                                      ///< of V - P delta; null with two stages
  std::shared_ptr<const StageRecurrence> stage_weights = {};  ///< of V with two stages, Kronecker sums
  std::shared_ptr<const StageTables> stage_tables = {};       ///< the same, other dynamics
  /// Factor of a sweep for errors that the next grid does not represent.
  double smoothing = 0;
  double contraction = NAN;  ///< forecast of a cycle with the next grid
  double error = 0;          ///< of V: largest relative difference from values that were not used to make it
  std::string description;
  std::shared_ptr<const PoleSum> fit = {};  ///< of V^, of a grid line for Kronecker sums; not of dense dynamics
  /// Lambda, n: V, and y with it, is divided by it row by row, which makes the diagonal of V_0 one; empty: it is not.
  Vector row_scale = {};
  ModeSymbols symbols = {};  ///< of some modes, from which d is chosen; sparse and supplied dynamics
};

/// A description of V, or the reason why there is none.
struct DualChoice {
  std::optional<DualWeights> weights;
  std::string refusal;
};

/// V of the problem's grid, by implicit Euler (`stages` 1) or Radau IIA (2). Refused where M + K is singular, where y
/// acts on the second or a higher derivative of w, where V grows (zeros of M + N (zI - A)^{-1} B in the right
/// half-plane), and for dynamics or M without a dual form. With `finer`, V of a grid with shorter steps or more stages,
/// its fit is used again. This is possible since a rule sees V^ in a part of the right half-plane that shrinks as h
/// grows, and the part of implicit Euler lies in that of Radau IIA; the same holds for the zeros.
DualChoice dual_weights(const DiscreteProblem&, Index stages = 1, const DualWeights* finer = nullptr);

/// The part for sparse and supplied dynamics.
DualChoice fitted_dual_weights(const DiscreteProblem&, Index stages, const DualWeights* finer);
/// The boundary in the upper half-plane of the region where a rule takes V^, from near 0 to the positive real axis.
std::vector<Complex> rule_boundary(Index stages, double h, Index J, Index points);
inline constexpr int dual_sweeps = 3;  ///< before the coarse problem; one more follows it
/// The part for dense dynamics.
DualChoice dense_dual_weights(const DiscreteProblem&);
DualChoice refused_dual(std::string why);
/// Whether y is determined by M or the first derivative of w: L^T N B R is regular for bases L, R of the left and right
/// null space of M. `terms`: |N| |B|, against which N B is small.
bool has_relative_degree_one(const Matrix& M, const Matrix& NB, const Matrix& terms);
inline constexpr const char* two_derivatives =
    "y acts on the second or a higher derivative of w, so that M + K has no inverse in w alone (relative degree)";

/// The d that minimises max |1 - v/d| over values v of V^, and that maximum.
std::pair<double, double> best_divisor(const std::vector<Complex>& values);
/// Frequencies in [pi/4, pi] a step, which the grid with half the steps does not represent.
inline constexpr Index high_frequencies = 13;
double high_frequency(Index i);

/// V of implicit Euler for dense dynamics, without the split. Precondition: M + W_0 is regular.
DenseRecurrence inverse_recurrence(const DenseDynamics&, const Matrix& M, double h);

}  // namespace bromwich
