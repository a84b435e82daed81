#pragma once
// The inverse of a problem in time. With K the convolution of implicit Euler on a grid, V = (M delta + K)^{-1} in the
// ring of causal convolutions, and r the terms of w without y,
//
//     0 <= w  ⊥  y = V w + s >= 0,   s = -V r.
//
// V is the convolution quadrature of V^(z) = (M + N (zI - A)^{-1} B)^{-1} at z = (1 - zeta)/h. It is split as
// P delta + (V - P delta), so that this is a problem like the primal one with the matrix P in place of M:
//
//     w <- SOL(P, s + (V - P delta) w),
//
// for P = d I the projected Richardson sweep w <- max(0, w - (V w + s)/d), and for a multiple of V_0 a block sweep.
//
// Kronecker sums: one scalar inverse per sine mode, as a short sum of exponentials (core/kernel/transfer_fit.hpp).
// Dense dynamics: the step with the roles of y and w exchanged. With R = (I - hA)^{-1}, W_0 = h N R B, V_0 = (M +
// W_0)^{-1},
//
//     y_j = V_0 (w_j - N R x_{j-1}),   x_j = (R - h R B V_0 N R) x_{j-1} + h R B V_0 w_j.

#include "../kernel/discrete_problem.hpp"
#include "../kernel/transfer_fit.hpp"
#include "../kernel/weights.hpp"

#include <memory>
#include <optional>
#include <string>

namespace bromwich {

struct DualWeights {
  LcpMatrix P;            ///< d I, tridiagonal, for Kronecker sums; (1 + alpha) V_0 otherwise
  SharedWeights weights;  ///< of V - P delta
  /// Factor of a sweep for errors with frequencies in [pi/4, pi] a step, which the next grid does not represent.
  double smoothing = 0;
  double error = 0;  ///< of V: largest relative difference from values that were not used to make it
  std::string description;
  std::shared_ptr<const PoleSum> fit = {};  ///< of V^ of a grid line; Kronecker sums only
};

/// What V is, or why there is none.
struct DualChoice {
  std::optional<DualWeights> weights;
  std::string refusal;
};

/// V of the problem's grid. Refused where M + K is singular, where y acts on the second or a higher derivative of w,
/// where V grows (zeros of M + N (zI - A)^{-1} B in the right half-plane), and for dynamics or M without a dual form.
/// With `finer`, V of a grid with shorter steps, its fit is used again: implicit Euler sees V^ on discs |1 - hz| <= 1,
/// of which the one of longer steps lies in the other, and so do zeros.
DualChoice dual_weights(const DiscreteProblem&, const DualWeights* finer = nullptr);

/// The eigenvalues of M in the sine modes: M is a symmetric tridiagonal Toeplitz matrix. Empty otherwise.
std::optional<Vector> eigenvalues_in_modes(const LcpMatrix& M);

/// V of implicit Euler for dense dynamics, without the split. Precondition: M + W_0 is regular.
DenseRecurrence inverse_recurrence(const DenseDynamics&, const Matrix& M, double h);

}  // namespace bromwich
