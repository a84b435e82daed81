#pragma once
// Steps of collocation in one mode, as long as the polynomials of x, f and g are resolved.

#include "event_sources.hpp"
#include "mode.hpp"

#include <Eigen/LU>

#include <vector>

namespace bromwich {

struct EventStep;

/// Largest absolute values of each component so far.
struct EventSizes {
  JetValues u;
  Vector y;

  void include(const EventStep&);
  void include_x(const Vector& x) { u.x = u.x.cwiseMax(x.cwiseAbs()); }
  EventSizes with(const EventStep&) const;
};

/// A step in one mode: polynomials on [0, length], valid on the first `valid` of it.
struct EventStep {
  double length = 0, defect = INFINITY, valid = 0;
  Index event = -1;        ///< the component of y or w that becomes negative after `valid`
  bool at_once = false;    ///< it is not positive before
  bool shortened = false;  ///< it is shorter than proposed
  LegendreCoefficients x, y, w;
  EventSources::Polynomials sources;
  LegendreCoefficients df, dg, ddg;
  EventSizes sizes;               ///< those of the step included
  Vector doubt;                   ///< n: error of y, since values of y and w below zero were counted as zero
  Vector rounding_y, rounding_w;  ///< n: of their values
  Vector zero_y, zero_w;          ///< n: values up to these count as zero
};

/// Where the integration is.
struct EventPoint {
  double t = 0;
  double end = 0;         ///< the next breakpoint, or T
  double h = 0;           ///< the proposed step
  Vector x;               ///< m
  Vector y;               ///< n: the limit from the left
  Vector zero_y, zero_w;  ///< n: values of y and w from the left that count as zero; empty at t = 0
  Vector integral;        ///< n: of y from 0, impulses included
  EventSizes sizes;
  double work = 0;  ///< floating-point operations so far, about
};

class EventSteps {
 public:
  /// `tolerance` and `longest` as in EventOptions; `span`: the longest time without a breakpoint. The first three have
  /// to outlive the object.
  EventSteps(const SystemMatrices&, const EventSources&, double T, double span, double tolerance, double longest);

  double longest_from(const EventPoint& p) const { return std::min({p.h, longest_, p.end - p.t}); }
  /// Values below this share of the sum of their terms count as zero.
  double noise() const;
  /// How far a constant |y| moves the state within the longest step: m values.
  Vector moved_within_step(const Vector& y) const { return by_y_within_step_ * y; }
  /// Of a state at rest, whose own size says nothing of the terms that cancel in its changes: m values.
  Vector rounding_of_x(const EventSizes&) const;
  /// Whether a step was refused since rounding of y moves the state: the sign of y is not known.
  bool sign_is_lost() const { return sign_is_lost_; }

  /// The longest resolved step in a mode, with its validity. False if none is. `free`: components whose sign does not
  /// count.
  bool resolve(const SwitchedMode&, EventPoint&, EventStep&, const std::vector<char>* free = nullptr);
  /// f, g and their derivatives, those that the mode needs, on [t, t + h] with an h that resolves them. Returns h.
  double sample_resolved(const SwitchedMode&, const EventPoint&, EventStep&) const;

 private:
  void sample(const SwitchedMode&, double t, double h, EventStep&) const;
  EventStep attempt(const SwitchedMode&, EventPoint&, double h);
  bool sources_agree(const SwitchedMode&, const JetValues& size, const EventStep&) const;
  bool y_is_known(const SwitchedMode&, const EventStep&) const;
  void find_event(const SwitchedMode&, const std::vector<char>* free, EventStep&) const;
  JetValues rounding_of(const EventStep&) const;
  void set_zeros(const SwitchedMode&, const EventPoint&, EventStep&) const;
  double defect_of_signs(const SwitchedMode&, const EventStep&) const;
  Vector doubt(const SwitchedMode&, const EventStep&) const;
  void look_closer(EventPoint&, EventStep&) const;
  double work_of_sources() const;
  double source_defect(const JetValues& size, const EventSources::Polynomials&) const;
  void factorize(const SwitchedMode&, double h, double& work);
  ComplexVector solve(std::size_t eigenvalue, const ComplexVector& right) const;

  const SystemMatrices& system_;
  const EventSources& sources_;
  double T_, tolerance_, longest_;
  bool rigid_;             ///< there are rigid contacts
  Matrix sizes_behind_M_;  ///< n x n
  /// How constant values of f and y move the state within the span, and within the longest step.
  Matrix by_f_within_span_, by_y_within_span_, by_f_within_step_, by_y_within_step_;
  /// Positions: y does not act on their rates, nor do they depend on each other. They are eliminated.
  std::vector<Index> positions_, others_;
  Matrix by_others_, by_positions_;  ///< the rates of positions by the others, and the other way in the mode
  /// Of I - z A_S for z = h lambda without the positions; kept as long as mode and h stay.
  std::vector<Eigen::PartialPivLU<ComplexMatrix>> factors_;
  const SwitchedMode* factored_mode_ = nullptr;
  double factored_h_ = 0;
  bool sign_is_lost_ = false;
};

}  // namespace bromwich
