#pragma once
// Implicit Euler steps of very short length: they propose active sets, select impulses and pass accumulated events.

#include "../lcp/lcp_class.hpp"
#include "event_sources.hpp"
#include "mode.hpp"

namespace bromwich {

class ShortSteps {
 public:
  /// The first two have to outlive the object.
  ShortSteps(const SystemMatrices&, const EventSources&, double T);

  /// Whether the complementarity problems of short steps determine the solution. `lcp_class`: of M.
  bool unique(LcpClass lcp_class);

  /// Whether they determine y too, and not only the state. After `unique`.
  bool determine_y() const { return has_one_solution(class_); }

  struct Step {
    bool solved = false;
    Vector y, x;
  };
  /// From x at t to t + h. `offset` is subtracted from g.
  Step take(double t, double h, const Vector& x, const Vector& offset) const;

  /// Of the dynamics: max(1 / T, |A|).
  double rate() const { return rate_; }

 private:
  Matrix response(double h) const;
  bool is_monotone(const Matrix& S) const;

  const SystemMatrices& system_;
  const EventSources& sources_;
  double rate_;
  LcpClass class_ = LcpClass::P;  ///< of the matrix of a short step
};

}  // namespace bromwich
