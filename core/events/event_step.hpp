#pragma once
// Steps of collocation in one mode, as long as the polynomials of x, f and g are resolved.

#include "event_sources.hpp"
#include "mode.hpp"
#include "propagators.hpp"

#include <algorithm>
#include <map>
#include <vector>

namespace bromwich {

struct EventStep;

/// Largest absolute values of each component so far.
struct EventSizes {
  JetValues u;
  Vector y;

  /// `before` and the step.
  void set_with(const EventSizes& before, const EventStep&);
  void set_sources_with(const EventSizes& before, const EventStep&);
  void set_values_with(const EventSizes& before, const EventStep&);  ///< x and y
  void include(const EventStep& step) { set_with(*this, step); }
  void include_x(const Vector& x) { u.x = u.x.cwiseMax(x.cwiseAbs()); }
  EventSizes with(const EventStep&) const;
};

/// A step in one mode: polynomials on [0, length], valid on the first `valid` of it.
struct EventStep {
  double length = 0, defect = INFINITY, valid = 0;
  Index event = -1;        ///< the component of y or w that becomes negative after `valid`
  bool at_once = false;    ///< it is not positive before
  bool shortened = false;  ///< it is shorter than proposed, and not since a breakpoint is near
  LegendreCoefficients x, y, w;
  EventSources::Polynomials sources;
  LegendreCoefficients df, dg, ddg;
  EventSizes sizes;               ///< those of the step included
  Vector doubt;                   ///< n: error of y, since values of y and w below zero were counted as zero
  Vector rounding_y, rounding_w;  ///< n: of their values
  Vector zero_y, zero_w;          ///< n: values up to these count as zero

  /// Coefficients of `count` rows of a jet without their part of x.
  void set_without_x(const JetCombination& rows, Index count, LegendreCoefficients& sum) const;
};

/// Coefficients of Legendre polynomials bound the values.
inline auto bounds(const LegendreCoefficients& c) { return c.cwiseAbs().colwise().sum().transpose(); }

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

/// Of all steps of an integration.
struct StepLimits {
  double span = 0;       ///< the longest time without a breakpoint
  double tolerance = 0;  ///< as in EventOptions
  double longest = 0;

  bool operator==(const StepLimits&) const = default;
};

class EventSteps {
 public:
  /// The first two have to outlive the object.
  EventSteps(const SystemMatrices&, const EventSources&, double T, const StepLimits&);

  /// Before another integration.
  void begin(const StepLimits&);

  double longest_from(const EventPoint& p) const;
  /// Values below this share of the sum of their terms count as zero.
  double noise() const;
  /// How far a constant |y| moves the state within the usual step: m values.
  Vector moved_within_step(const Vector& y) const { return by_y_within_step_ * y; }
  /// Of a state at rest, whose own size says nothing of the terms that cancel in its changes within a usual step: m
  /// values.
  Vector rounding_of_x(const EventSizes&) const;
  /// A step within which rounding of the terms of x' adds up, at least.
  double usual_length() const { return std::min(limits_.longest, T_ / fewest_steps); }
  /// Whether a step was refused since rounding of y moves the state: the sign of y is not known.
  bool sign_is_lost() const { return sign_is_lost_; }

  /// The longest resolved step in a mode, with its validity. False if none is. `free`: components whose sign does not
  /// count.
  bool resolve(const SwitchedMode&, EventPoint&, EventStep&, const std::vector<char>* free = nullptr);
  /// The same of the first step in a mode, which is no longer than the steps that began there before could be: what
  /// fast transients allow is learnt once.
  bool resolve_first(const SwitchedMode&, EventPoint&, EventStep&);
  /// How much longer than a resolved step the next one may be.
  double room(const EventStep&) const;
  /// f, g and their derivatives, those that the mode needs, on [t, t + h] with an h that resolves them. Returns h.
  double sample_resolved(const SwitchedMode&, const EventPoint&, EventStep&) const;

 private:
  void sample(const SwitchedMode&, double t, double h, EventStep&) const;
  void attempt(const SwitchedMode&, EventPoint&, double h, EventStep&);
  void hold_constraints(const SwitchedMode&, EventStep&);
  bool sources_agree(const SwitchedMode&, const JetValues& size, const EventStep&) const;
  bool y_is_known(const EventStep&) const;
  void find_event(const SwitchedMode&, const std::vector<char>* free, EventStep&) const;
  void set_rounding(const EventStep&);
  void set_rounding_of_x(const Vector& f, const Vector& y, double length, Vector& rounding) const;
  void set_zeros(const SwitchedMode&, const EventPoint&, EventStep&);
  double defect_of_signs(const SwitchedMode&, const EventStep&) const;
  void set_doubt(const SwitchedMode&, EventStep&) const;
  void look_closer(EventPoint&, EventStep&) const;
  double work_of_sources() const;
  double longer_than_usual(double length) const { return std::max(1.0, length / usual_length()); }
  double source_defect(const JetValues& size, const EventSources::Polynomials&) const;

  const SystemMatrices& system_;
  const EventSources& sources_;
  double T_;
  StepLimits limits_;
  Propagators propagators_;
  Combination B_, N_, M_;
  bool rigid_;  ///< there are rigid contacts
  /// How constant values of f and y move the state within the span, and within the usual step.
  Matrix by_f_within_span_, by_y_within_span_, by_f_within_step_, by_y_within_step_;
  bool sign_is_lost_ = false;
  std::map<const SwitchedMode*, double> first_lengths_;
  // Storage of an attempt.
  LegendreCoefficients input_, y_of_sources_, off_;
  JetValues rounding_;
  Vector terms_y_, rounding_x_;
  mutable Vector moved_;
};

}  // namespace bromwich
