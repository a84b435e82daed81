#pragma once
// Values at any time of a scene that method events solves, and the times of its switches, from one more integration:
// between located switches x and y are polynomials.

#include "../events/event_driven.hpp"
#include "../result/switching.hpp"
#include "../scene/natural_units.hpp"

#include <optional>
#include <vector>

namespace bromwich {

class LocatedValues {
 public:
  /// Nothing where the scene is of another kind, or the integration ends early.
  static std::optional<LocatedValues> find(const Scene&);
  /// With this tolerance of the last coefficients of steps.
  static std::optional<LocatedValues> find(const Scene&, double tolerance);

  /// In the units of the scene; at jumps the limit from the left.
  Vector x(double t) const;
  Vector y(double t) const;

  /// The integration, in natural units, and these units.
  const EventSolution& solution() const { return solution_; }
  const NaturalUnits& units() const { return units_; }

  /// In order of time. y_i is on where it is positive between two events, above `negligible` times its largest value.
  /// The error is that of rounding; accumulated events are passed in one step, whose length it is there.
  std::vector<Switch> switches(double negligible = 1e-12) const;

 private:
  EventSolution solution_;
  NaturalUnits units_;
};

}  // namespace bromwich
