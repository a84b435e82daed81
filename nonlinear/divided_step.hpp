#pragma once
// A step in which f, g, phi or gamma jumps or has a kink, in parts that end there. Every part sees the values of its
// own side. Where y is continuous in between (rule linear) it may jump at such a time: a part begins with y of its own
// side.

#include "nonlinear_steps.hpp"

#include <array>
#include <vector>

namespace bromwich {

/// Times at which steps are divided: those that the scene states, as for linear scenes, and found jumps of f or g.
/// Found kinks need no division: they cost h^2 in one step.
std::vector<double> divisions_of(const Scene&);

/// What the parts have in common with the other steps.
struct StepOptions {
  StepRule rule = StepRule::linear;
  bool least = false;        ///< as NonlinearSteps::select_least
  double tolerance = 1e-12;  ///< of Newton's iteration
  Index most_newton = 30;
  std::array<double, 3> sizes{};  ///< of x, y and w, as NonlinearSteps::sizes
};

/// From x, y at t to those at t + length, before a jump there. `breaks`: in (t, t + length], increasing. The scene is
/// one of in_states.
NewtonOutcome take_divided(const NonlinearScene&, Backend&, const StepOptions&, double t, double length,
                           const std::vector<double>& breaks, Vector& x, Vector& y);

/// Times as far from a breakpoint are on one side of it, relative to T: rounding of expressions of t.
constexpr double side_of_break = 1e-12;

}  // namespace bromwich
