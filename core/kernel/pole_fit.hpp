#pragma once
// Few poles for dynamics that are known by shifted solves. H(z) of core/host/pole_model.hpp is computed at a few dozen
// nodes, poles are picked for all its entries together, and residues are a least-squares fit. Three more nodes decide
// how many poles there are. Six others are not used for the fit: they give the error of the finished model.
//
// Nodes. All weights of a grid with step h are integrals of H along a curve to the right of the poles:
//
//     W_d = 1/(2 pi i) ∫ F_d(z) H(z) dz,   |F_d(z)| = h |e^{(d-1)hz} phi1(hz)^2|  (see kernel.hpp).
//
// The curve is the imaginary axis from 0.3/T to 8/h, bent to the left from there, where e^{hz} decays. The nodes are on
// it and on the arc |z| = 8/h that closes the region of the stages of Radau IIA. Their weight is sqrt(min(1, |hz|))
// e^{min(0, Re hz)}. Faster parts of the state than 8/h are not resolved by a step: they are in the constant D.
//
// Poles. Real, from a logarithmic grid, picked by a column-pivoted QR of their Cauchy matrix at the nodes. As they are
// negative, every model is stable. With a spectrum far from the real axis the fit misses its tolerance.
//
// Residues. The unconstrained fit gives K(t); the pole s_k and slower ones are omitted for directions of y whose K(t)
// has fallen below the tolerance at t = 1/|s_k|, so that the residues of slow poles have low rank. They are then fitted
// again.

#include "../host/pole_model.hpp"
#include "discrete_problem.hpp"

#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace bromwich {

struct PoleFit {
  std::shared_ptr<const PoleModel> model = {};  ///< null: see `reason`
  std::string reason = {};                      ///< why no poles were found
  Index nodes = 0;                              ///< shifted solves
  double error = INFINITY;                      ///< of the model, or of the fit that was refused
};

/// Largest error at the nodes held out, of each block (constraints or components) x (y, a source, x0), with the weights
/// above, relative to the largest value of the block. Up to this limit a fit may replace lag weights.
inline constexpr double accepted_pole_error = 1e-9;

struct PoleLimits {
  Index most_poles = std::numeric_limits<Index>::max();
  double accepted_error = accepted_pole_error;
};

/// The model of the problem's dynamics for its step and times up to T.
PoleFit fit_pole_model(const DiscreteProblem&, const std::vector<Index>& components, PoleLimits = {});

}  // namespace bromwich
