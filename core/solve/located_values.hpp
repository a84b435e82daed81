#pragma once
// Values at any time of a scene that method events solves, from one more integration: between located switches x and y
// are polynomials.

#include "../events/event_driven.hpp"
#include "../scene/natural_units.hpp"

#include <optional>

namespace bromwich {

class LocatedValues {
 public:
  /// Nothing where the scene is of another kind, or the integration ends early.
  static std::optional<LocatedValues> find(const Scene&);

  /// In the units of the scene; at jumps the limit from the left.
  Vector x(double t) const;
  Vector y(double t) const;

 private:
  EventSolution solution_;
  NaturalUnits units_;
};

}  // namespace bromwich
