#pragma once
// States between the time points of a march, by shorter steps of Radau IIA from the time point before. Behind a
// breakpoint they begin short and double.

#include "../scene/scene.hpp"
#include "radau_steps.hpp"

#include <cmath>

namespace bromwich {

class StepsBetween {
 public:
  /// `h`: of the steps of the march. The scene, which Radau steps suit, has to outlive the object.
  StepsBetween(const Scene&, double h);

  /// The row at begin + s, 0 < s <= h, from x and y at the time point `begin`; its integral of y is that from there.
  /// With the same begin and a larger s than last time the steps go on from there. Null: a step has no solution.
  const TreeRow* at(double begin, const Vector& x, const Vector& y, double s);

 private:
  bool pass(double a, double b, bool layer);
  bool breaks_in(double from, double until) const;

  const Scene& scene_;
  const double h_, same_time_;
  RadauSteps steps_;
  double begin_ = NAN, t_ = NAN;
  TreeRow row_;
};

}  // namespace bromwich
