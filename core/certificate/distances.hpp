#pragma once
// How far a result is from a located solution, at its rows. Where y jumps, a row may have either limit. Where a source
// jumps at T the last row is not compared: a march has it behind the jump, and a located solution ends before it.

#include "../events/event_driven.hpp"
#include "../result/result.hpp"
#include "linear_steps.hpp"

#include <vector>

namespace bromwich {

class Defect;

class Distances {
 public:
  /// `effect`: B above M, what y does to x and w. All have to outlive the object.
  Distances(const EventSolution&, const Scene&, const Result&, const LinearSteps&, const Matrix& effect);

  /// Rows j, j + 1, ... with the states x, one row each; in the order of time, but for row 0.
  void add(Index j, const Eigen::Ref<const RowMatrix>& x);
  void summarise(const Defect&, Certificate&) const;

 private:
  Index rows_inside(const EventPiece&, Index j, Index rows) const;
  void add_inside(const EventPiece&, Index j, const Eigen::Ref<const RowMatrix>& x);
  void add_row(Index j, const Vector& x);
  template <class A, class B, class C>
  void add_state(const A& x, const B& true_x, const C& off);

  const EventSolution& located_;
  const double T_;
  const Result& r_;
  const LinearSteps& y_;
  const Matrix& effect_;
  const bool jumps_at_end_;
  Vector x_size_, y_off_, y_size_, mean_off_, effect_off_, effect_size_, x_off_;
  std::vector<double> of_rows_;  ///< of x, relative to the values so far
};

}  // namespace bromwich
