#pragma once

#include "../accuracy/convergence.hpp"
#include "../events/event_driven.hpp"
#include "../result/inner_options.hpp"
#include "../result/notice.hpp"
#include "../seam/backend.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

namespace bromwich {

/// The tolerance, and the limits of the attempt.
struct EventGoal {
  double tolerance = 0;  ///< 0: none, and the grid is that of the options
  bool of_y = true, of_x = true;
  double most_work = 1e11;  ///< floating-point operations of each integration, about
  /// With the operations of all integrations so far and those that are still needed, by what part of the time has taken
  /// what: the operations before it is asked again, see EventOptions. Empty: it is not asked.
  std::function<double(double done, double needed)> budget = {};
  double first = 0;  ///< tolerance of the first integration, see EventOptions; 0: it follows from `tolerance`
  /// From the more accurate solution: how far x (m) and y (n) are off since x0 is. Empty: x0 is exact.
  std::function<std::pair<Vector, Vector>(const EventSolution&)> error_of_start = {};
};

/// Floating-point operations of each integration, where grids have not solved the scene or the method is named.
inline constexpr double patient_events = 1e11;

/// By the tolerances of the options.
EventGoal event_goal(const InnerOptions&, double most_work = patient_events);

/// A small scene by located events (core/events): two integrations, the second a thousand times as accurate. The second
/// is returned, and its difference to the first is the estimate of its error, and of its switching times. If that is
/// above the tolerance, the second is compared with a third.
///
/// With a tolerance the rows of the result are those of a grid of at least the scene's default steps, halved until y
/// and x are linear between them to the tolerance, where they are continuous. Without one the grid is that of the
/// options.
///
/// Status solved; unsupported for another kind of scene; interrupted; or tolerance_not_met where an integration ended
/// early or the integrations differ by more than the tolerance, with the rows up to there. Scene::breakpoints have to
/// be all jumps and kinks of the sources.
Result solve_by_events(const Scene&, Backend&, const InnerOptions&, const ComponentSizes&, const EventGoal&);

/// The same, with what ended it: too_many_steps or other_state.
struct EventAttempt {
  Result result;
  std::optional<Notice> cause;
};
EventAttempt try_events(const Scene&, Backend&, const InnerOptions&, const ComponentSizes&, const EventGoal&);

/// A solution by located events that errors of other methods are measured against: of two integrations the more
/// accurate one, where they differ by less than a tenth of the tolerance.
class EventReference {
 public:
  /// Nothing where the scene is of another kind, or the integrations end early or differ. `J`: steps of the grid on
  /// which they are compared. Scene and backend have to outlive the object.
  static std::optional<EventReference> find(const Scene&, Backend&, const InnerOptions&, const ComponentSizes&,
                                            const EventGoal&, Index J);

  /// t, y, its integral and the recorded x on a grid of J steps.
  Result on(Index J) const;
  bool continuous() const { return solution_->continuous; }  ///< y, after t = 0

 private:
  EventReference(const Scene&, Backend&, std::vector<Index> components, std::shared_ptr<const EventSolution>);

  const Scene* scene_;
  Backend* backend_;
  std::vector<Index> components_;
  std::shared_ptr<const EventSolution> solution_;
};

}  // namespace bromwich
