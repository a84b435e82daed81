#pragma once
// The discrete convolution v_j = Σ_d W_d y_{j-d} (v_0 = 0) written as a linear recurrence with a state z:
//
//     v_j = W_0 y_j + w1 y_{j-1} + C z_{j-1},      z_j = E z_{j-1} + G y_j,      z_0 = G0 y_0 + initial,
//
// so that W_1 = w1 + C G and W_d = C E^{d-1} G for d >= 2. y_0 enters with s1 and G0 instead, x0 with `initial`. `w1`
// and `s1` are the parts of lag 1 that the exponentials do not represent. Marching, scans, sums over lags and the
// implicit Euler method use this form with different numbers.
//
// symbol    variable  shape
// E         decay     K x n (one bank of K exponentials per mode) or m x m
// C         output    K x n or n x m
// G         -         1 per mode, or m x n
// G0        start     K x n or m x n; differs from G because y_0 is the end point of a single interval

#include "../base/types.hpp"
#include "../host/pole_model.hpp"
#include "../numerics/face_basis.hpp"

#include <memory>
#include <variant>
#include <vector>

namespace bromwich {

/// Exponentials that all entries of lag weights have in common: W_d = Σ_k E_k^{d-1} C_k for d >= 1, and S = 0. A part
/// of lag 1 alone has E_k = 0.
struct SharedExponentials {
  Vector decay;      ///< K: E_k
  RowMatrix output;  ///< row k: the entries of C_k, row by row
};

/// Lag weights: row d holds W_d; row j of S holds S_j, the weight of y_0.
struct LagTable {
  Index outputs = 0, inputs = 0;
  bool modal = false;   ///< true: W_d is diagonal and a row holds its n entries; false: n x k entries, row by row
  RowMatrix W, S;       ///< (J+1) x n, or (J+1) x (n k); row 0 of S is zero
  FaceBasis face = {};  ///< as of ModalRecurrence, if modal
  std::shared_ptr<const SharedExponentials> exponentials = {};  ///< null: not known

  FaceBasis basis() const { return face.empty() ? FaceBasis{outputs} : face; }
};

/// One scalar convolution per mode, K real exponentials each. Matrices are K x n with the mode index contiguous.
struct ModalRecurrence {
  RowMatrix decay;
  RowMatrix output;
  RowMatrix start;
  RowMatrix initial;  ///< K x n, or empty: contribution of x0 to z_0, instead of a table of its response
  Vector w0;          ///< n: W_0 per mode
  Vector w1;          ///< n: W_1 - Σ_k C_k, the part of lag 1 outside the exponentials
  Vector s1;          ///< n: the same for the weight of y_0
  /// Modes of a face of n points. Empty: sine modes of a side.
  FaceBasis face = {};
  /// The modes come in this many blocks of one length. Within a block all modes have the same exponentials but for
  /// their own decay: rates s_k + mu_l with amplitudes c_k.
  Index families = 1;

  Index modes() const { return w0.size(); }
  Index exponentials() const { return decay.rows(); }
  Index family(Index mode) const { return mode * families / modes(); }
  FaceBasis basis() const { return face.empty() ? FaceBasis{modes()} : face; }
};

/// z is the state of the dynamics: E = e^{hA} or (I - hA)^{-1}.
struct DenseRecurrence {
  Matrix decay;   ///< m x m
  Matrix input;   ///< m x n, G
  Matrix start;   ///< m x n, G0
  Matrix output;  ///< n x m
  Matrix w0;      ///< n x n
};

/// A convolution with two stages in each step, in modes like ModalRecurrence and with one state for both: with y_1, y_2
/// at the stages of step j,
///
///     v_a,j = Σ_b W_ab y_b,j + w1_a y_2,j-1 + Σ_k C_a z_{j-1},      z_j = E z_{j-1} + Σ_b G_b y_b,j,      z_0 = 0.
///
/// Arrays have 2J + 1 rows: row 2j - 1 holds the first stage of step j and row 2j the second; row 0 is not used.
struct StageRecurrence {
  RowMatrix decay;                ///< K x n
  RowMatrix input[2], output[2];  ///< K x n, G_b and C_a
  Vector w0[2][2];                ///< n, W_ab
  Vector w1[2];                   ///< n

  Index modes() const { return decay.cols(); }
  Index exponentials() const { return decay.rows(); }
};

using Recurrence = std::variant<ModalRecurrence, DenseRecurrence>;

/// The state of a PoleModel on a grid with step h, y linear between time points:
///     ζ_j = e^{hs} ζ_{j-1} + h (phi1 - phi2)(hs) u_{j-1} + h phi2(hs) u_j,   v_j = U ζ_j + D y_j,   ζ_0 = 0.
struct PoleRecurrence {
  std::shared_ptr<const PoleModel> model;
  double h = 0;
};

using Weights = std::variant<Recurrence, LagTable, PoleRecurrence>;

/// Non-owning pointer to one form of the weights.
using WeightsRef = std::variant<const ModalRecurrence*, const DenseRecurrence*, const LagTable*>;
inline WeightsRef weights_ref(const LagTable& table) { return &table; }
inline WeightsRef weights_ref(const Recurrence& recurrence) {
  return std::visit([](const auto& r) -> WeightsRef { return &r; }, recurrence);
}

/// The part from stage b to stage a.
ModalRecurrence part_of(const StageRecurrence&, int a, int b);

/// W_0 = V diag(w0) V^T, n x n: the matrix that a marching step adds to M.
Matrix implicit_part(const ModalRecurrence&);

/// Growth rate of the weights per lag; 0 if they grow less than tenfold. The error of an FFT is relative to its largest
/// input, so it is applied to values damped by e^{-growth d} and undamped afterwards; this commutes with causal
/// convolution.
double growth(const RowMatrix& W);

/// e^{-sigma j}, j = 0..rows-1.
Vector damping(double sigma, Index rows);

/// base^exponent by squaring. Not compiled by nvcc: it compiles Eigen without vector instructions under the same symbol
/// names, and the linker may then use its products in the whole program.
Matrix matrix_power(Matrix base, Index exponent);

}  // namespace bromwich
