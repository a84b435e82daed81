#pragma once
// Derivatives of a solution whose switches are located, also where y or x jumps.
//
// Between switches the active set S is constant, and a change of the data obeys the dynamics of S with other sources
// (core/events/mode.hpp), exactly solved on each part (derivatives/part_maps.hpp):
//
//     dx' = A dx + B dy + f~,   (N dx + M dy + g~)_S = 0,   f~ = dA x + dB y + df,   g~ = dN x + dM y + dg.
//
// c is the y_i or w_i that vanishes at a switch, c(x, t) = 0. The time of the switch changes by dt = -dc/c' and the
// state by the saltation (Aizerman & Gantmacher 1958; di Bernardo et al., Piecewise-smooth Dynamical Systems, 2008,
// section 2.5)
//
//     dx+ = dx- + (x'- - x'+) dt,
//
// with the derivative of the map x+ = x- + B p where the state jumps. The integral of y gets (y- - y+) dt + dp. vjp is
// the transpose of all these maps in reverse order.
//
// With E0 x(0) + ET x(T) = b, and D the derivative of x(T) by x(0) (core/shooting/flow_derivative.hpp), x(0) changes by
//
//     (E0 + ET D) dx0 = db - dE0 x(0) - dET x(T) - ET dphi,
//
// where dphi is the change of x(T) with x(0) held.
//
// A switch is differentiable if the set after it stays the one after it: each component that vanishes there has to
// vanish with c to first order. Otherwise (two switches at once, a grazing switch, y_i = w_i = 0 for some time, events
// that accumulate) the constructor refuses: not differentiable here.

#include "../core/scene/natural_units.hpp"
#include "solution_derivative.hpp"

#include <Eigen/LU>

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

class SwitchedTape;  // derivatives/switched_tape.hpp

class SwitchedDerivative {
 public:
  static constexpr double usual_tolerance = 1e-11;

  /// `times`: increasing, from 0 to T, those of all tables. Throws Error where the scene is not dense and small, where
  /// the integration with located switches ends early, and where the solution is not differentiable. `along_some`:
  /// where constraints with y_i = w_i = 0 at a switch, at t = 0, or from one switch to the next leave a derivative
  /// along changes that keep them so, that is one; other changes throw Error. `tolerance`: of the integration
  /// (EventOptions). `start`: with a boundary condition, an x(0) near that of the solution; empty: none is known.
  SwitchedDerivative(const Scene&, const Vector& times, bool along_some = false, double tolerance = usual_tolerance,
                     const Vector& start = {});
  ~SwitchedDerivative();
  SwitchedDerivative(SwitchedDerivative&&) noexcept;

  const Vector& times() const { return t_; }
  /// Limits from the right (at T: from the left) at the times.
  const SolutionChange& values() const { return values_; }
  const DerivativeMargin& margin() const { return margin_; }
  /// Times at which the active set changes with the solution.
  const std::vector<double>& switches() const { return switch_times_; }
  /// Members of `times` at a switch: their rows are limits from the right, and a derivative from one side.
  const std::vector<Index>& one_sided() const { return one_sided_; }
  /// Empty, or why there is no derivative with respect to M: y jumps at a switch, or M_SS is singular.
  const std::string& without_M() const { return without_M_; }

  /// Empty, or why only some changes have a derivative.
  const std::string& only_along() const { return only_along_; }

  /// x(0), from which the boundary condition was met; empty without one.
  const Vector& start() const { return start_; }

  /// Throws Error for a change of M where there is no derivative with respect to it.
  SolutionChange jvp(const DataChange&) const;
  /// The same where times at which f or g jump change, too. Throws Error for times that are no breakpoints of the
  /// scene.
  SolutionChange jvp(const DataChange&, const std::vector<MovingJump>&) const;
  /// M is empty where there is no derivative with respect to it. Without a boundary condition, where only some changes
  /// have a derivative, all members are empty on which its conditions depend: x0; f, A, B and E; or g, N and M. Throws
  /// Error where none is left (with a boundary condition x(0) depends on all), and for weights on one-sided rows.
  DataChange vjp(const SolutionChange&) const;

 private:
  void scale(SolutionChange&) const;
  void scale(DataChange&) const;
  // E0 x(0) + ET x(T) = b, in natural units.
  struct Ends {
    BoundaryCondition condition;
    Vector first, last;                ///< x(0) and x(T)
    Eigen::FullPivLU<Matrix> closing;  ///< of E0 + ET D
  };
  void find_start(Scene&, double tolerance, const Vector& start);
  Vector change_of_start(const DataChange&, const std::vector<MovingJump>&) const;
  DataChange with_ends(SolutionChange of, const Vector& of_start) const;

  Vector t_;
  SolutionChange values_;
  DerivativeMargin margin_;
  std::vector<double> switch_times_;
  std::vector<Index> one_sided_;
  std::string without_M_, only_along_;
  NaturalUnits units_;
  std::optional<Ends> ends_;  ///< with a boundary condition
  Vector start_;
  Matrix inverse_E_;                          ///< empty: E = I
  std::unique_ptr<const SwitchedTape> tape_;  ///< in natural units
};

}  // namespace bromwich
