#pragma once
// A step in which f, g, phi or gamma jumps or has a kink, in parts that end there. Every part sees the values of its
// own side. Where y is continuous in between (rule linear) it may jump at such a time: a part begins with y of its own
// side.

#include "nonlinear_steps.hpp"

#include <vector>

namespace bromwich {

/// From x, y at t to those at t + length, before a jump there. `breaks`: in (t, t + length], increasing. `least`: as
/// NonlinearSteps::select_least.
NewtonOutcome take_divided(const NonlinearScene&, Backend&, StepRule, bool least, double tolerance, Index most_newton,
                           double t, double length, const std::vector<double>& breaks, Vector& x, Vector& y);

/// Times as far from a breakpoint are on one side of it, relative to T: rounding of expressions of t.
constexpr double side_of_break = 1e-12;

}  // namespace bromwich
