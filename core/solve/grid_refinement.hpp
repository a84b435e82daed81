#pragma once
// Finer and finer grids until the estimated error meets a tolerance: what solve_to_tolerance does where located events
// do not serve (core/solve/error_control.hpp). grid_refinement.cpp solves the grids, grid_verdict.cpp judges them.

#include "../accuracy/interior_check.hpp"
#include "../base/timer.hpp"
#include "error_goal.hpp"
#include "event_control.hpp"
#include "given_steps.hpp"

#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// Floating-point operations of event-driven integration before grids are tried: more where sources have edges, for
/// each of which grids have steps, too.
inline double quick_events(const Scene& scene) { return 1e9 + 2e6 * double(scene.breakpoints.size()); }

class GridRefinement {
 public:
  /// `measures`: errors may be those against located events.
  GridRefinement(const Scene& scene, Backend& backend, const InnerOptions& options, bool measures);

  Result run();
  /// Another grid, and where it serves a march on steps of their own, with about that many operations at most: the
  /// result, or nothing where it is not the last.
  std::optional<Result> advance(double most_operations = INFINITY);
  /// Operations that grids need, about, as far as their errors say; `of_next`: those of the next alone.
  double operations_to_goal() const;
  double operations_of_next() const { return operations(next_); }

 private:
  static constexpr double accepted = 0.8;        ///< of the tolerance
  static constexpr double left_by_cycles = 0.1;  ///< of the tolerance: more sweeps on the same grid reduce larger ones

  std::optional<Result> next_grid(double most_operations);
  double operations(Index J) const;
  std::optional<std::string> judgement();
  /// Which budget a grid of J steps would exceed; empty: none.
  std::string spent(Index J) const;
  /// Method march with steps of their own for all parts of the time, once, or again with more operations.
  std::optional<Result> on_tree(double most_operations);
  void add_grid(Index J) {
    grids_.push_back(J);
    estimates_.push_back(NAN);
  }
  Result solve_on(Index J) { return solve_on(J, options_.method); }
  Result solve_on(Index J, Method method);
  bool may_look_inside() const;
  /// All states were recorded; those that the options ask for stay in the result.
  void keep_recorded(Result& result);
  /// Whether a grid that was not solved ends the search. On a coarse grid anything may go wrong.
  bool is_final(const Result& next) const;
  void take(Result& next);
  /// A method that is named is measured against located events where these solve the scene (automatic takes these).
  void look_for_reference();
  /// The error itself: that of y, or of its mean where y jumps, and that of x.
  void measure(ErrorEstimate& e) const;
  /// Cycles end where they leave a share of the largest error, and sweeps with a change below a tolerance. Where what
  /// is left is too much for a small component, or not known to be small after one sweep, they go on.
  void iterate_on();
  bool leaves_too_much() const;
  bool holds_inside();
  /// Jumps that stay in their steps when these are halved do not on a grid of 3/4 of the steps. Where that cannot be
  /// compared the estimate is not relied on.
  void check();
  /// Nothing but such jumps stands against the tolerance.
  bool hangs_on_check() const;
  /// g that jumps inside steps enters contour, multigrid and Euler by its values at their ends: a pulse between them is
  /// in no difference of grids. Method march takes such steps in parts.
  /// It also does so where the state jumps, which method galerkin notices late on all grids.
  bool misses_inside() const;
  /// The same of kinks, and of pulses with slopes, in sparse scenes and Kronecker sums.
  bool takes_g_at_points() const;
  /// Boundary values, with y linear on intervals in which f or g jumps or has a kink.
  bool has_rough_intervals() const;
  void check_beside_march();
  Result blocks_by_march();
  /// Why grids of this method cannot show that they miss nothing; empty: with more steps they can.
  std::optional<std::string> why_unchecked() const;
  void estimate();
  void doubt_sudden_drops(ErrorEstimate&);
  bool hides_error() const { return (convergence_->of_integral() ? hidden_.mean : hidden_.largest) > goal_.smallest(); }
  bool controls_states() const { return goal_.x > 0 && solved_->x.cols() > 0; }
  /// Whether the estimates can be relied on.
  bool judged() const;
  bool met() const;
  /// Empty: the tolerance is met. Nothing: go on. Otherwise why it will not be met.
  std::optional<std::string> verdict() const;
  static double discretisation(const ErrorEstimate& e) { return std::isnan(e.discretisation) ? 0 : e.discretisation; }
  /// Reasons to end that no grid changes.
  std::string limit_of_grids() const;
  std::optional<std::string> hopeless(const GridDifferences& d, double goal, double other, const char* what) const;
  /// The result of a coarser grid stays, except where the scene has no solution.
  Result ended_by(Result& next);
  Result failed(Result& next);
  Result ended(const std::string& reason, Status status = Status::tolerance_not_met);

  const Scene& scene_;
  Backend& backend_;
  const InnerOptions& options_;
  const ErrorGoal goal_;
  const ComponentSizes sizes_;
  const Index expected_;  ///< steps with which the scene is meant to be solved
  Index next_;            ///< steps of the next grid
  std::vector<Index> grids_;
  std::vector<double> estimates_;           ///< of grids_
  std::optional<Result> solved_, failed_;   ///< the last grid of each kind; failed_ only if it is the last of all
  std::optional<Convergence> convergence_;  ///< of the grids that the method of solved_ has solved
  Index tried_tree_ = 0;                    ///< steps that it had at most
  bool tried_reference_;
  std::optional<EventReference> reference_;
  bool unchecked_ = false;                 ///< the grid that checks the last one could not
  double share_;                           ///< of the error of a grid, that cycles may leave
  double last_change_;                     ///< of y, at which sweeps end
  std::optional<Distance> beside_march_;   ///< of the last grid, where g jumps inside steps
  double seen_ = NAN, seen_before_ = NAN;  ///< estimates of the last grid and the one before, from differences alone
  double missed_ = 0;                      ///< of g that jumps inside steps, where march is no other method
  RowMatrix all_states_;                   ///< of the last grid, where there are few
  HiddenError hidden_;                     ///< of solved_
  std::size_t shown_ = 0;                  ///< last grids whose differences show their errors of y
  Seconds spent_;
  Timer clock_;
  double elapsed_ = 0, last_seconds_ = 0;
};

}  // namespace bromwich
