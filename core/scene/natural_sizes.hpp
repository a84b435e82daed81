#pragma once
// The natural sizes X, Y and W of states, y and w, from the data of a scene before it is solved. In units of these all
// terms of the equations should have size 1,
//
//     a_ij X_j / (r_i X_i),   b_ij Y_j / (r_i X_i),   n_ij X_j / W_i,   m_ij Y_j / W_i,
//     x0_i / X_i,   max |f_i| / (r_i X_i),   max |g_i| / W_i,      r_i = max(1/T, |a_ii|),
//
// (sqrt(r_i r_j) for r_i if both a_ij and a_ji are nonzero, so that a symmetric A stays symmetric) and their logarithms
// vanish in the sense of least squares. Terms that become small have small weights (core/scene/size_terms.hpp).
// Other units of x_i, y_i, w_i or t change the sizes exactly as they change the variables, to rounding.
//
// Above 4000 unknowns or 1e5 entries, and for Kronecker sums, the sizes are common to all states, all y and all w.

#include "scene.hpp"

namespace bromwich {

/// All positive; 1 if nothing is known of a variable.
struct NaturalSizes {
  Vector x, y, w;
};

NaturalSizes natural_sizes(const Scene&);

/// Those of a Kronecker sum: one value for all components.
struct CommonSizes {
  double x, y, w;
};
CommonSizes common_sizes(const KroneckerDynamics&, const Scene&);

/// Largest |value| of each component at irregular times between 0 and T, which do not coincide with jumps or periods.
/// Values that are not finite are ignored.
Vector largest_values(const TimeFunction&, Index width, const Scene&);

}  // namespace bromwich
