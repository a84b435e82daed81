#pragma once
// The kernel K(t) = N e^{At} B on a grid t_j = j h, from shifted solves on contours.
//
// For continuous piecewise-linear y the convolution ∫ K(t_j - s) y(s) ds is Σ_d W_d y_{j-d} with weights
// 1/(2 pi i) ∫ F(z) N (zI - A)^{-1} B dz. With x = h z:
//
//     F_0 = h e^x/x^2,   F_1 = h (e^{2x} - 2e^x)/x^2,   F_d = h e^{(d-1)x} phi1(x)^2           (d >= 2)
//     column of y_0:     S_1 : h e^x (x-1)/x^2,         S_d : h e^{(d-1)x} (phi1 - phi2)(x)    (d >= 2)
//
// (0 lies inside the contour: the parts of lags 0 and 1 without e^x integrate to zero and are left out.) Lag d needs t
// in [(d-1)h, (d+1)h]; lags 0 and 1 need [h, 2h] and have their own contour.

#include "../base/error.hpp"
#include "../dynamics/line_transfer.hpp"
#include "../numerics/contour.hpp"
#include "../seam/backend.hpp"

namespace bromwich {

/// The factors of one window of lags, with the contour weights c_p included.
struct LagWindow {
  Index first = 0, last = 0;  ///< lags d
  Contour contour;
  ComplexMatrix F, S;  ///< (last-first+1) x (P+1)
};

/// Lags 0 and 1, then windows of ratio 5, covering 0..J. `shift` moves every node to the right, past such eigenvalues.
std::vector<LagWindow> lag_windows(const ContourParameters&, double h, Index J, double shift = 0);

/// The same, for grids that share the solves of most windows: lags 0 and 1, lags 2 to 4, and then windows that begin at
/// 4^k `common`, the step of one of the grids. For steps h = common 2^k, and 4/3 of it; otherwise as lag_windows.
std::vector<LagWindow> shared_lag_windows(const ContourParameters&, double h, Index J, double shift, double common);

/// The factors of lags first..last on a contour that covers them.
LagWindow lag_window(const Contour&, double h, Index first, Index last);

/// c_p e^{z_p t_j} for j = first..last.
ComplexMatrix exponential_factors(const Contour&, double h, Index first, Index last);

/// Re(F R), R with one row per node. No complex product is formed.
void real_product(const ComplexMatrix& F, const ComplexMatrix& R, Eigen::Ref<RowMatrix> out);

/// W_d and S_d for d = 0..J: one batch of shifted solves for the nodes of each window, then one product per window.
LagTable contour_lag_table(Backend&, const Dynamics&, const ContourParameters&, double h, Index J);

/// N e^{A t_j} x0 for j = 0..J in the sine basis of the constraints, (J+1) x n. All lines share the nodes: e^{At} =
/// e^{along t} ⊗ e^{across t}, and only the second factor needs a contour. `x0_lines` is x0 transformed in the `along`
/// direction only (n x across.points).
RowMatrix contour_initial_response(const KroneckerDynamics&, const ContourParameters&, const RowMatrix& x0_lines,
                                   double h, Index J);

}  // namespace bromwich
