#pragma once
// The complementarity problem of velocities of a part or an impact, and roots of cubics.

#include "../lcp/active_set.hpp"
#include "../lcp/blocks.hpp"

#include <optional>
#include <vector>

namespace bromwich {

struct ImpactSolution {
  bool solved = false, fallback = false;
  int newton = 0;
  double residual = 0;  ///< relative to the terms of the rows
  Vector z;
  Vector at_end;  ///< of parts: z over the part, with the friction of its end in place of the mean
};

/// LCP(q, W) by the active set of the last problem. Where that fails: Lemke's method with a larger diagonal, and then
/// the linear system of the set that it has found, without it.
ImpactSolution solve_impact_problem(ActiveSetLcp& lcp, const Matrix& W, const Vector& q);

/// Rows of a problem with friction on a circle.
struct ImpactCone {
  Index first;
  double mu;
  bool given;
};

/// Problems with one W: rows of the orthant, and cones.
class ImpactProblem {
 public:
  ImpactProblem(Matrix W, std::vector<ImpactCone> cones);

  /// The next problem starts from the active set {z > 0}.
  void start_from(const Vector& z);

  /// `slides`, 2 x cones, or empty: directions in which contacts slide at the begin of a part, or 0. Their friction is
  /// the mean of that of the begin and that of the end, which has order 2 where directions turn.
  ImpactSolution solve(const Vector& q, const Matrix& slides = {});

 private:
  ImpactSolution over_cones(const Vector& q, const Matrix& slides);

  Matrix W_;
  std::vector<ImpactCone> cones_;
  std::vector<Index> orthant_;
  std::optional<ActiveSetLcp> lcp_;  ///< of the rows of the orthant, where there are any
};

/// Values and slopes at both ends.
struct Cubic {
  double w0, slope0, w1, slope1;
};
/// The first time in [0, d] at which the cubic falls from 0 or above to less than -zero; infinite: none.
double first_fall(const Cubic&, double d, double zero);

}  // namespace bromwich
