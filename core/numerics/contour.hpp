#pragma once
// Hyperbolic contours for the inverse Laplace transform. For t in a window [t0, ratio t0],
//
//     F(tA) = 1/(2 pi i) ∫_Γ F(z) (zI - A)^{-1} dz  ≈  Σ_{p=-P}^{P} c_p F(z_p) (z_p I - A)^{-1},
//     z(v) = mu/t0 (1 + sin(iv - gamma)),   z_p = z(p dv),   c_p = dv/(2 pi i) z'(p dv),
//
// so all time points of a window share nodes, factorizations and solves (López-Fernández, Palencia, Schädle, SIAM J.
// Numer. Anal. 44, 2006; Weideman, Trefethen, Math. Comp. 76, 2007). For real A the nodes are conjugate pairs and only
// p = 0..P are stored: the sum is then 2 Re with half weight at p = 0.

#include "../base/types.hpp"

#include <optional>
#include <vector>

namespace bromwich {

/// gamma, dv and mu of a hyperbola; mu is in units of 1/t0.
struct HyperbolaShape {
  double gamma, spacing, mu;
};

/// Parameters found by minimising the worst error over the sector |arg(-a)| <= half_angle, in double precision
/// (scripts/contour_parameters.py).
struct ContourParameters {
  double half_angle;      ///< of the sector that contains the spectrum, radians
  Index P;                ///< nodes p = 0..P
  HyperbolaShape window;  ///< for e^{at}, t in a window of ratio 5
  double error;           ///< its largest error
  HyperbolaShape near;    ///< for the weights of lags 0 and 1: their 1/z^2 needs a contour farther from 0
};

/// Ratio t1/t0 of the windows for which the stored parameters are made.
inline constexpr double window_ratio = 5;

/// The stored parameters with the fewest nodes for a sector of at least `half_angle` and an error of at most
/// `tolerance`; empty if there are none (half-angles above 60 degrees, tolerances below about 1e-14).
std::optional<ContourParameters> contour_parameters(double half_angle, double tolerance = 1e-14);

/// Nodes and weights of one window, upper half of the contour only.
struct Contour {
  double t0 = 0, t1 = 0;  ///< the window
  ComplexVector nodes;    ///< z_p, p = 0..P, 1/time
  ComplexVector weights;  ///< c_p, doubled for p >= 1: F(tA) ≈ Re Σ_p weights_p F(z_p) (z_p I - A)^{-1}
};

Contour window_contour(const ContourParameters&, double t0);

/// For the weights of lags 0 and 1 at step h: t in [h, 2h], a double pole at z = 0.
Contour near_contour(const ContourParameters&, double h);

/// A circle around the spectrum, for entire functions of hA with any spectrum of radius rho, including oscillators and
/// unstable modes. Radius max(2 rho, rho + 3/h), center 0, t0 = 0, t1 = 2h. The trapezoidal rule has 128 nodes (64
/// stored); its error is about 2^-128 or (rho/radius)^128, plus rounding of eps e^{h radius}. Empty for h rho > 9.
std::optional<Contour> circle(double rho, double h);

/// The contour of (2.2) of the Laplace-inversion paper with its printed parameters for one time point t: gamma = 0.794,
/// mu = sqrt(P)/4, dv = 2.0603/sqrt(P). The paper gives the error as e^{-2.06 sqrt P}/sqrt P (2.8).
Contour literal_contour(Index P, double t);

}  // namespace bromwich
