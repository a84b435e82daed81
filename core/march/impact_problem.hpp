#pragma once
// The complementarity problem of velocities of a part or an impact, and roots of cubics.

#include "../lcp/active_set.hpp"

namespace bromwich {

struct ImpactSolution {
  bool solved = false, fallback = false;
  int newton = 0;
  double residual = 0;  ///< relative to the terms of the rows
  Vector z;
};

/// LCP(q, W) by the active set of the last problem. Where that fails: Lemke's method with a larger diagonal, and then
/// the linear system of the set that it has found, without it.
ImpactSolution solve_impact_problem(ActiveSetLcp& lcp, const Matrix& W, const Vector& q);

/// Values and slopes at both ends.
struct Cubic {
  double w0, slope0, w1, slope1;
};
/// The first time in [0, d] at which the cubic falls from 0 or above to less than -zero; infinite: none.
double first_fall(const Cubic&, double d, double zero);

}  // namespace bromwich
