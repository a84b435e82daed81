#pragma once
// Shooting on located events: the x(0) of a small dense scene with E0 x(0) + ET x(T) = b.
//
// With the flow Phi of core/events, right to rounding, and its derivative D (core/shooting/flow_derivative.hpp),
// Newton's method for F(x) = E0 x + ET Phi(x) - b solves
//
//     (E0 + ET D) dx = -F(x),
//
// where active sets may change from one iteration to the next. E0 + ET D is regular where constraints fix the modes of
// A that E0 + ET e^{TA} leaves open. Steps are halved until F falls, measured by the sizes of its terms. F is smooth in
// pieces: where a quarter of a step does not bring it down, some whole steps are taken, through pieces where F is
// larger. With periodic conditions the iteration starts from the end of the second period after rest; where Newton
// steps do not bring F down, more periods follow, both from where they were and from where the method has come, which
// may be far from any solution. Whole steps across pieces come after these.

#include "../events/event_driven.hpp"

#include <functional>
#include <string>
#include <vector>

namespace bromwich {

struct ShootingOptions {
  EventOptions events;
  Vector start = {};        ///< m: the first x(0); empty: rest, or the x of least norm with E0 x = b
  double most_work = 1e11;  ///< floating-point operations of all integrations, about
};

struct ShootingSolution {
  bool found = false;
  bool interrupted = false;
  std::string reason;           ///< why it is not found
  Vector x0;                    ///< m
  Matrix D;                     ///< m x m: x(T) by x(0), at the last iterate but one
  bool free = false;            ///< no constraint is active on the way from that iterate
  double condition = 1;         ///< reciprocal, of E0 + ET D in comparable sizes
  bool determined = true;       ///< false: E0 + ET D is singular, and other x(0) solve the problem too
  Index newton = 0, flows = 0;  ///< steps taken, and integrations
  std::vector<double> history;  ///< F relative to its terms, after each step
};

/// integrate_with_events, with finer tolerances where it ends early: what counts as zero falls with the tolerance, and
/// signs may be known then. The work is that of all.
EventSolution integrate_closely(const Scene&, LcpClass lcp_class, const std::vector<double>& breakpoints, EventOptions);

/// x(T) of a complete one, m values.
Vector end_of_flow(const EventSolution&);

/// Eigenvalues of the derivative of x(T) by x(0), the largest first.
std::vector<Complex> multipliers_of(const Matrix& D);

/// Whether the condition is x(0) = x(T).
bool is_periodic(const BoundaryCondition&);

/// A scene with a boundary condition that is otherwise suited to events; `lcp_class` and `breakpoints` as
/// integrate_with_events takes them.
ShootingSolution shoot_on_events(const Scene&, LcpClass lcp_class, const std::vector<double>& breakpoints,
                                 const ShootingOptions&);

/// The Newton step from x0 with a more accurate flow, and the largest changes of x and y that follow from it: what the
/// error of x0 means.
struct StartError {
  Vector x, y;  ///< m and n: absolute values
};
StartError error_of_start(const Scene&, const ShootingSolution&, const EventSolution& flow);

}  // namespace bromwich
