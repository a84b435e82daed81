#pragma once
// The derivative of the flow x(0) -> x(t) of a small dense scene, along a solution with located switches.
//
// On a piece with the active set S a change of the state follows dx' = A_S dx (core/events/mode.hpp), once it fulfils
// the constraints of S. At a switch c(x, t) = 0, c the y_i or w_i that vanishes there, its time changes by
// dt = -dc / c', and
//
//     dx+ = dx- + (x'- - x'+) dt,
//
// with the derivative of x+ = x- + B p where the state jumps (Aizerman & Gantmacher 1958); with restitution p depends
// on the velocity before the impact, and on the forces then. States that are set have the change 0, and so have the
// numbers of the modes of memories, whatever they were at t = 0. Breakpoints of f and g do not move. Accumulated
// events, passed by one short step, count as no change: the constraints of the set after them hold.
//
// derivatives/switched_tape.hpp has the same equations for changes of all data, and refuses what is differentiable
// from one side only. Here such a point has a derivative of one side: a Newton iteration takes any.

#include "../events/event_driven.hpp"
#include "../events/mode.hpp"
#include "../events/regime.hpp"

#include <functional>
#include <map>
#include <optional>
#include <utility>
#include <vector>

namespace bromwich {

/// The largest changes on the way from 0 to T.
struct FlowChange {
  Vector x, y;  ///< m and n
};

/// Of those components of y and w that do not switch on the way: their least value, and its change by k directions.
struct FlowMargins {
  Vector least;
  Matrix change;  ///< a row for each of them, k columns
};

class FlowDerivative {
 public:
  /// A scene with dense dynamics that outlives the object. What solutions have in common is kept.
  explicit FlowDerivative(const Scene&);

  /// x(T) by x(0): m x m. The solution is complete.
  Matrix at_end(const EventSolution&);
  /// For a change of x(0).
  FlowChange along(const EventSolution&, const Vector& dx0);
  /// For changes of x(0) by the columns.
  FlowMargins margins(const EventSolution&, const Matrix& dx0);

 private:
  /// The scene in the modes of a piece, with its active sets.
  struct System {
    Regime regime;
    std::map<std::vector<Index>, std::optional<SwitchedMode>> sets = {};

    System(const Scene& scene, const std::vector<Index>& modes) : regime(scene, modes) {}
  };
  System& system_of(const EventPiece&);
  const SwitchedMode* mode_of(const EventPiece&, const std::vector<Index>& active);
  const Matrix& propagator(const SwitchedMode*, double length);
  /// `note`: called at both ends of each piece.
  using Note = std::function<void(const EventPiece&, const SwitchedMode&, bool end, const Matrix& dx)>;
  Matrix carried(const EventSolution&, Matrix dx, const Note& note);
  Vector values_of(const EventPiece&, Index component, bool of_y);
  void pass(const EventPiece* before, const EventPiece& after, Matrix& dx);
  Eigen::RowVectorXd moved_times(const EventPiece& before, const Matrix& dx);
  JetValues values_at(const EventPiece&, double at);
  void jump(const EventPiece* before, const EventPiece& after, const Eigen::RowVectorXd& dt, Matrix& dx);

  const Scene& scene_;
  std::map<std::vector<Index>, System> systems_;  ///< by the modes of the memories
  std::map<std::pair<const SwitchedMode*, long long>, Matrix> propagators_;
};

}  // namespace bromwich
