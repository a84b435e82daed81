#pragma once
// Free unknowns of a mixed problem (w_i = 0, y_i of either sign), eliminated from the discrete problem: with f the free
// and c the other components of an interval,
//
//     z_f = -D_ff^+ (D_fc z_c + C_f x_{k-1} + q_f),
//
// which leaves a problem of the same form without free unknowns. If D_ff is singular, equations that contradict each
// other prove that there is no solution; redundant equations leave only z_f undetermined, and that of least norm is
// taken.

#include "discretisation.hpp"

#include <optional>

namespace bromwich {

class FreeElimination {
 public:
  /// `free_rows` of the scene. Throws Error if D_ff is singular and the free unknowns depend on the others.
  FreeElimination(const GalerkinProblem&, const std::vector<Index>& free_rows);

  /// The problem in z_c; the given one if there are no free rows.
  const GalerkinProblem& reduced() const { return reduced_ ? *reduced_ : full_; }

  /// z_c from z.
  RowMatrix bound_part(const RowMatrix& z) const;

  /// z from z_c and x.
  RowMatrix recovered(const RowMatrix& z_c, const RowMatrix& x) const;

  /// First interval, counted from 0, in which the equations contradict each other.
  std::optional<Index> contradiction() const { return contradiction_; }
  bool unique() const { return unique_; }

 private:
  void eliminate(const GalerkinRun&, GalerkinStep& reduced);

  const GalerkinProblem& full_;
  std::optional<GalerkinProblem> reduced_;
  std::vector<Index> free_, bound_;
  std::vector<Matrix> inverses_;  ///< D_ff^+ of each run
  std::optional<Index> contradiction_;
  bool unique_ = true;
};

}  // namespace bromwich
