#pragma once
// f and g of a scene as polynomials on the steps of the event-driven integration.

#include "../scene/scene.hpp"
#include "collocation.hpp"

namespace bromwich {

class EventSources {
 public:
  /// A scene with dense dynamics that outlives the object.
  explicit EventSources(const Scene&);

  bool any() const { return bool(scene_.f) || bool(scene_.g); }
  Vector f(double t) const;  ///< m values, as x' = A x + B y + f takes them
  Vector g(double t) const;  ///< n values

  struct Polynomials {
    LegendreCoefficients f, g;    ///< of m and n components
    Vector off_f, off_g;          ///< largest differences from the sources that were seen, m and n values
    Vector unknown_f, unknown_g;  ///< differences up to these are rounding of t
  };
  /// On [t, t + h]; the differences are those at Collocation::checks.
  Polynomials sample(double t, double h) const;
  /// Increases the differences to those at both ends: a kink may lie between an end and the next sample.
  void look_at_ends(double t, double h, Polynomials&) const;
  /// Increases the differences to those at `count` times: a pulse may lie between the samples.
  void look_between(double t, double h, Index count, Polynomials&) const;

 private:
  void value_of_f(double t, Vector& value) const;
  void value_of_g(double t, Vector& value) const;
  void look(double t, double h, double at, Polynomials&) const;

  const Scene& scene_;
  Index m_, n_;
  Matrix F_;  ///< f = F phi where the scene gives phi
};

}  // namespace bromwich
