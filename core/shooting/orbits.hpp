#pragma once
// Motions over one period, and what their ends, derivatives and switches say.
//
// symbol  variable   shape    meaning
// z       -          m+1      (x(0), p)
// F       F          m        E0 x(0) + ET x(T) - b
// D       D          m x m    x(T) by x(0)

#include "../events/event_driven.hpp"
#include "bromwich/continuation.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// How often each component of y and w becomes active or strikes within a period. Bounces that end in rest are not
/// counted.
using OrbitForm = std::vector<Index>;
OrbitForm form_of(const EventSolution&, Index n);

struct Orbit {
  double p = 0;
  std::shared_ptr<const Scene> scene;  ///< with initial values
  BoundaryCondition condition;
  EventSolution flow;
  Vector x0;
  Vector F = {}, size = {};  ///< size: the largest values of the states
  Matrix D = {};
  OrbitForm form = {};
};

/// How many are outside of the unit circle, but for rounding.
Index growing(const std::vector<Complex>& multipliers);

/// Of an orbit that is periodic.
BranchPoint point_of(const Orbit&);

class Orbits {
 public:
  Orbits(const std::function<Scene(double)>& scene_of, double from, double to, const ContinuationOptions&);

  /// The first periodic state, at `from`. Nothing: why() says more.
  std::optional<Orbit> first();
  /// The motion that starts at x(0). If none does, it starts at the nearest x(0) that fulfils the constraints. Nothing:
  /// why() says more. D is computed where `with_derivative` is set.
  std::optional<Orbit> from(const Vector& x0, double p, bool with_derivative = true);
  /// dF/dp by a difference of F along dz, m+1 values, and D: on the side where the form is the same if there is one.
  std::optional<Vector> by_parameter(const Orbit&, const Vector& along);

  double range() const { return std::abs(to_ - from_); }
  bool inside(double p) const { return std::min(from_, to_) <= p && p <= std::max(from_, to_); }
  Index integrations() const { return integrations_; }
  bool interrupted() const { return options_.interrupted && options_.interrupted(); }
  const std::string& why() const { return why_; }

 private:
  struct Stated {
    std::shared_ptr<Scene> scene;
    BoundaryCondition condition;
    LcpClass lcp_class;
  };
  Stated stated(double p);

  const std::function<Scene(double)>& scene_of_;
  const double from_, to_;
  const ContinuationOptions& options_;
  Index states_ = -1, integrations_ = 0;
  std::string why_;
};

}  // namespace bromwich
