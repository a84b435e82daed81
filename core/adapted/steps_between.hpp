#pragma once
// States between the time points of a march of dense dynamics, by shorter steps from the time point before: the exact
// flow with y linear on each step (certificate/part_weights.hpp) and complementarity at the nodes of Radau IIA. Behind
// a breakpoint steps begin short and double; the shortest has one y, since the state may jump there.

#include "../certificate/part_sources.hpp"
#include "../certificate/part_weights.hpp"
#include "tree_march.hpp"

#include <cmath>
#include <map>
#include <memory>

namespace bromwich {

class StepsBetween {
 public:
  /// Dense dynamics without E, that suits Radau steps; `h`: of the steps of the march. The scene has to outlive the
  /// object.
  StepsBetween(const Scene&, double h);
  ~StepsBetween();
  static bool suit(const Scene&);

  /// The row at begin + s, 0 < s <= h, from x and y at the time point `begin`; its integral of y is that from there.
  /// With the same begin and a larger s than last time the steps go on from there. Null: a step has no solution.
  const TreeRow* at(double begin, const Vector& x, const Vector& y, double s);

 private:
  struct OfLength;
  OfLength& of(double length);
  bool breaks_in(double from, double until) const;
  bool pass(double a, double b, bool layer);
  bool take(const Part&);

  const Scene& scene_;
  const DenseDynamics& d_;
  const Matrix M_;
  const double h_, same_time_;
  PartSampler sources_;
  std::unique_ptr<PartWeightsFamily> weights_;
  std::map<double, std::unique_ptr<OfLength>> kept_;  ///< by length
  double begin_ = NAN, t_ = NAN;
  TreeRow row_;
};

}  // namespace bromwich
