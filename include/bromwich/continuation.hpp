#pragma once
// Periodic states followed in a parameter: frequency responses and other bifurcation diagrams.
//
// A branch is the curve of all (x(0), p) with x(0) = x(T) in the scene of p, from a first state on. It may turn back in
// p (a fold); stable and unstable states lie on it.

#include "scene.hpp"
#include "types.hpp"

#include <functional>
#include <string>
#include <vector>

namespace bromwich {

struct ContinuationOptions {
  /// The longest step along the branch: of the parameter a share of |end - start|, or of the states five times this
  /// share of their sizes.
  double longest_step = 0.01;
  double tolerance = 1e-9;  ///< of the integrations, relative to the sizes of the states
  Index max_points = 5000;
  Vector x0 = {};  ///< m: an x(0) near the first state; empty: the state to which motion from rest settles
  std::function<bool()> interrupted = {};
};

/// One state of a branch.
struct BranchPoint {
  double parameter = 0;
  double T = 0;                      ///< the period
  Vector x0;                         ///< m
  Vector least, largest;             ///< m: of the states within the period
  std::vector<Complex> multipliers;  ///< m, the largest first: see Result::multipliers
  bool stable = false;               ///< none is outside of the unit circle
  Index impacts = 0;                 ///< within the period: jumps of the state by impulses
};

/// What happens to the states of a branch at one place.
enum class BranchEvent : char {
  fold,             ///< the branch turns back in the parameter
  grazing,          ///< a component of y or w touches zero: an impact, a contact or a slip begins or ends to be
  period_doubling,  ///< a multiplier passes -1
  torus,            ///< a pair of multipliers leaves or enters the unit circle
  branching,        ///< a multiplier passes 1 and the branch does not turn: another branch crosses
};
const char* to_string(BranchEvent);

struct BranchMark {
  BranchEvent event;
  double parameter = 0;
  Vector x0;
  Index after = 0;       ///< the point before it
  Index component = -1;  ///< of y and w, at a grazing
};

struct Branch {
  std::vector<BranchPoint> points;
  std::vector<BranchMark> marks;  ///< in their order on the branch
  bool complete = false;          ///< it leaves [start, end], at either side
  std::string reason;             ///< why it is not complete
  Index integrations = 0;
};

/// The branch through the periodic state at `start`, followed towards `end` until it leaves the interval, by
/// pseudo-arclength continuation on shooting with located events (core/shooting). `scene_of` gives periodic scenes with
/// dense dynamics and the same states; T may depend on the parameter. Throws Error where they are something else.
Branch continuation(const std::function<Scene(double)>& scene_of, double start, double end,
                    const ContinuationOptions& = {});

}  // namespace bromwich
