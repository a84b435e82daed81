#pragma once
// Event-driven integration of small scenes with dense dynamics and initial values.
//
// Between events the active set is constant, and x' = A_S x + ... is solved by collocation
// (core/events/collocation.hpp). Steps are so short that the last coefficients of x, f and g are below a tolerance. An
// event is the first time at which the polynomial of some y_i or w_i is negative, located to rounding. There, and at
// breakpoints of the sources, a very short step of implicit Euler proposes the active set that continues. A step of
// collocation confirms it: y and w have to be nonnegative on it. Where the state does not fulfil the constraints of the
// new active set it jumps. Where events accumulate (sliding motion, Zeno), a short step of implicit Euler passes the
// accumulation.
//
// Where M, or the matrix of a short step of implicit Euler, is of class P, monotone or a limit of matrices of class P
// (core/lcp), the solution is unique. Otherwise all active sets are tried at every step, for few constraints, and the
// integration ends where two of them continue the solution differently, or impulses lead to different states. For more
// constraints the solution is one that may not be the only one.

#include "../lcp/matrix.hpp"
#include "../result/located_solution.hpp"
#include "../scene/scene.hpp"
#include "successor.hpp"

#include <functional>
#include <memory>
#include <string>

namespace bromwich {

/// What integrations of a scene have made of it. Those from another x(0), or with another tolerance, take it over.
class RegimesOfScene;
std::shared_ptr<RegimesOfScene> keep_regimes();

struct EventOptions {
  double tolerance = 1e-10;  ///< of the last coefficients, relative to the largest value of a component so far
  double longest_step = 0;   ///< 0: a 64th of T
  double most_work = 4e10;   ///< floating-point operations, about; more: the integration gives up
  /// At t, with that work done: the work up to which the integration goes on before it asks again. No more than what
  /// is done: it gives up.
  std::function<double(double work, double t)> budget = {};
  std::shared_ptr<RegimesOfScene> kept = {};  ///< of scenes that differ in x0 alone; null: nothing is kept
  std::function<bool()> interrupted = {};
  std::function<void(double t)> progress = {};
};

/// Why an integration is not complete.
enum class EventEnd : char {
  out_of_work,
  several_solutions,  ///< active sets continue it to different states
  other,
};

struct EventSolution : LocatedSolution {
  bool complete = false;
  bool interrupted = false;
  EventEnd end = EventEnd::other;
  std::string reason;  ///< why it is not complete
  double work = 0;     ///< floating-point operations, about
  Index events = 0, jumps = 0, accumulations = 0, breakpoints = 0;
  double defect = 0;       ///< largest last coefficients of all steps, as the tolerance counts them
  Vector doubt;            ///< n: error of y, since values below rounding and `tolerance` counted as zero
  bool unique = true;      ///< false: another solution may exist, and was not looked for
  bool continuous = true;  ///< y has no jump or impulse after t = 0
  Vector jump_at_start;    ///< n: the impulse at t = 0; empty if there is none
};

/// Whether the scene can be integrated in this way: dense dynamics without E, x(0) = x0, few unknowns, no free rows.
/// Otherwise why not.
std::string unsuited_to_events(const Scene&);

/// `lcp_class`: of M, never automatic. `breakpoints`: all jumps and kinks of f and g, increasing.
EventSolution integrate_with_events(const Scene&, LcpClass lcp_class, const std::vector<double>& breakpoints,
                                    const EventOptions&);

/// The largest |x| or |y| of each component, at the ends and in the middle of all pieces.
Vector largest_values(const EventSolution&, Matrix EventPiece::*which);

}  // namespace bromwich
