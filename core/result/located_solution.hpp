#pragma once
// A solution between located switches: x and y are polynomials there.

#include "../base/types.hpp"
#include "../numerics/legendre.hpp"
#include "bromwich/result.hpp"

#include <vector>

namespace bromwich {

/// A jump of the state by B p, entered with this active set.
struct EventImpulse {
  std::vector<Index> active;
  Vector p;       ///< n
  Vector e = {};  ///< n: the coefficients of restitution, 0 where the bounce would be too low to be seen; none: all 0
};

/// The solution on [begin, end], begin + length >= end: polynomials on [begin, begin + length].
struct EventPiece {
  double begin, length, end;
  Matrix x, y;                              ///< (s+1) x m and (s+1) x n Legendre coefficients
  Vector integral;                          ///< n: of y over [0, begin], impulses up to then included
  std::vector<Index> active = {};           ///< the active set
  std::vector<EventImpulse> impulses = {};  ///< at the begin, in their order
  std::vector<Index> set = {};              ///< states that memories have set at the begin, before impulses
  std::vector<Index> modes = {};            ///< one of each memory of the scene
  /// The component whose y_i (i active) or w_i vanishes at the end and would become negative; -1: none does.
  Index event = -1;
  bool passed = false;  ///< accumulated events, passed by a step of implicit Euler
};

struct LocatedSolution {
  std::vector<EventPiece> pieces;
  double until = 0;              ///< the solution is known up to here
  std::vector<Switch> switches;  ///< in order of time, with their errors

  /// The piece that holds t; where two meet, the one before with `left`.
  const EventPiece& piece(double t, bool left) const;
  /// m, n and n values. At jumps the limit from the left with `left`, and otherwise from the right.
  Vector x(double t, bool left) const;
  Vector y(double t, bool left) const;
  Vector integral_of_y(double t, bool left) const;
};

/// The times between pieces at which a memory changes its mode.
std::vector<ModeChange> mode_changes(const LocatedSolution&);

/// The times between pieces at which a component becomes positive or ceases to be. y_i is on where it is positive in a
/// piece, above `negligible` times its largest value. The error is that of rounding; accumulated events are passed in
/// one step, whose length it is there.
std::vector<Switch> switches_of(const LocatedSolution&, double negligible = 1e-12);

}  // namespace bromwich
