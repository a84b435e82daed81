#pragma once

#include <string>

namespace bromwich {

enum class Method {
  automatic,
  multigrid,        ///< cycles over nested time grids, in y or in w
  dual,             ///< the same in w, for M small, singular or zero (docs/dual.md)
  contour,          ///< functional iteration, all time points at once, shared contours
  contour_literal,  ///< (2.17) of the Laplace-inversion paper, one contour per time point
  march,            ///< time stepping: exponential with piecewise-linear y, or Radau IIA
  euler,            ///< implicit Euler (1.3)-(1.4)
  events,           ///< event-driven: collocation of high order between located switches (core/events)
  shooting,         ///< boundary values by Newton's method on x(0) with located events (core/shooting)
  galerkin,         ///< exponential Galerkin, all intervals at once: boundary values and mixed problems
                    ///< (core/galerkin/galerkin.hpp)
  goal,             ///< a time grid adapted to a quantity of interest (core/goal/goal.hpp)
};

/// "auto", "contour", ...
const char* to_string(Method);
/// Inverse of to_string; throws Error("method", ...) for an unknown name.
Method method_from_string(const std::string&);

/// Whether a method sweeps over all time points, so that its residual is limited by the iteration tolerance.
bool iterates(Method);

/// Whether switches are located, and not known to a step.
bool locates_switches(Method);

}  // namespace bromwich
