#pragma once
// The discrete convolution v_j = Σ_d W_d y_{j-d} (v_0 = 0) written as a linear recurrence with a state z:
//
//     v_j = W_0 y_j + w1 y_{j-1} + C z_{j-1},      z_j = E z_{j-1} + G y_j,      z_0 = G0 y_0 + initial,
//
// so that W_1 = w1 + C G and W_d = C E^{d-1} G for d >= 2; y_0 enters with s1 and G0 instead, x0 with `initial`. `w1`
// and `s1` carry what the exponentials do not represent at lag 1. Marching, scans, sums over lags and the implicit
// Euler method all run on this form and differ only in the numbers.
//
// symbol    variable  shape
// E         decay     K x n (one bank of K exponentials per mode) or m x m
// C         output    K x n or n x m
// G         -         1 per mode, or m x n
// G0        start     K x n or m x n; differs from G because y_0 is the end point of one interval only

#include "../base/types.hpp"

#include <variant>

namespace bromwich {

/// Lag weights: row d holds W_d, and S_d is the column of y_0.
struct LagTable {
  Index outputs = 0, inputs = 0;
  bool modal = false;  ///< true: W_d is diagonal and a row holds its n entries; false: n x k entries, row by row
  RowMatrix W, S;      ///< (J+1) x n, or (J+1) x (n k); row 0 of S is zero
};

/// One scalar convolution per sine mode, K real exponentials each. Matrices are K x n with the mode index contiguous.
struct ModalRecurrence {
  RowMatrix decay;
  RowMatrix output;
  RowMatrix start;
  RowMatrix initial;  ///< K x n, or empty: what x0 adds to z_0, in place of a table of its response
  Vector w0;          ///< n: W_0 per mode
  Vector w1;          ///< n: W_1 - Σ_k C_k, the part of lag 1 outside the exponentials
  Vector s1;          ///< n: the same for the column of y_0

  Index modes() const { return w0.size(); }
  Index exponentials() const { return decay.rows(); }
};

/// The state itself as z: E = e^{hA} or (I - hA)^{-1}.
struct DenseRecurrence {
  Matrix decay;   ///< m x m
  Matrix input;   ///< m x n, G
  Matrix start;   ///< m x n, G0
  Matrix output;  ///< n x m
  Matrix w0;      ///< n x n
};

using Recurrence = std::variant<ModalRecurrence, DenseRecurrence>;
using Weights = std::variant<Recurrence, LagTable>;

/// One of the forms of the weights, by reference.
using WeightsRef = std::variant<const ModalRecurrence*, const DenseRecurrence*, const LagTable*>;
inline WeightsRef weights_ref(const LagTable& table) { return &table; }
inline WeightsRef weights_ref(const Recurrence& recurrence) {
  return std::visit([](const auto& r) -> WeightsRef { return &r; }, recurrence);
}

/// W_0 = S diag(w0) S, n x n: what a step of marching adds to M.
Matrix implicit_part(const ModalRecurrence&);

/// Rate per lag at which weights grow; 0 where they do not grow tenfold. An FFT is accurate relative to its largest
/// input: e^{-growth d}, which commutes with causal convolution, goes before it and e^{growth d} after it.
double growth(const RowMatrix& W);

/// e^{-sigma j}, j = 0..rows-1.
Vector damping(double sigma, Index rows);

/// base^exponent by squaring. Here and not in sources of nvcc: it compiles Eigen without vector instructions under the
/// same names, and the linker may take its products for those of the whole program.
Matrix matrix_power(Matrix base, Index exponent);

}  // namespace bromwich
