#pragma once
// Dynamics of a linear complementarity system with a constant active set, and its jumps.
//
// symbol  meaning
// S       active set: w_S = 0, y = 0 elsewhere
// U, V    left and right null space of M_SS: U^T (N_S x + g_S) = 0 is a constraint on the state, and its derivative
//         determines the part of y along V (relative degree one)

#include "tests/support/oracle.hpp"

#include <optional>
#include <vector>

namespace bromwich::oracle {

/// y = y_of_x x + y_of_f f + y_of_g g + y_of_slope g', and x' = A x + ... with it. The constraint on (x, g) must
/// vanish.
struct Mode {
  unsigned set = 0;
  Matrix y_of_x, y_of_f, y_of_g, y_of_slope;  ///< n x m, n x m, n x n, n x n
  Matrix constraint_x, constraint_g;          ///< U^T N_S, U^T on the rows of S
};

/// Empty if the set does not determine y, even by differentiation.
std::optional<Mode> mode_of(const DenseScene&, unsigned set);

/// A jump of the state by B p.
struct Jump {
  Vector p, x;
};

/// All jumps from x with p >= 0, M p >= 0, p^T M p = 0, p ⊥ N x+ + g and a state x+ for which some y >= 0 exists.
/// `noise`: what counts as zero, for each row of N x + g.
std::vector<Jump> jumps_from(const DenseScene&, const Vector& x, const Vector& g, const Vector& noise);

}  // namespace bromwich::oracle
