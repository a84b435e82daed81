#pragma once
// Mixed problems with initial values: rows F with w_F = 0 and free y_F, the other rows C complementary.
//
//     y_F = -R (N_F x + M_FC y_C + g_F),   R = M_FF^{-1},
//
// which leaves a scene without free rows, with the Schur complement of M_FF as its M:
//
//     A' = A - B_F R N_F,      B' = B_C - B_F R M_FC,      f' = f - B_F R g_F,
//     N' = N_C - M_CF R N_F,   M' = M_CC - M_CF R M_FC,    g' = g_C - M_CF R g_F,      w' = w_C.

#include "reduction.hpp"

#include <optional>
#include <vector>

namespace bromwich {

struct EliminatedScene {
  Scene scene;              ///< without free rows; one constraint 0 <= y ⊥ y >= 0 if every row is free
  std::vector<Index> free;  ///< F
  std::vector<Index> kept;  ///< C
  Matrix R;                 ///< |F| x |F|
  Matrix M_FC, M_CF;        ///< |F| x |C|, |C| x |F|
  SparseMatrix N_F;         ///< |F| x m
  std::vector<Index> seen;  ///< states with a column of N_F that is not zero: recovery needs them

  /// A result of the whole scene as one of `scene`: its y_C (zero if every row is free).
  Result reduced(const Result&) const;

  /// y_F at the rows of y_C (rows x |C|), with the states `seen` and g_F there: rows x |F|.
  RowMatrix recover(const RowMatrix& y_C, const RowMatrix& x_seen, const RowMatrix& g_F) const;

  /// w_F <- w_F + N_F x, from the states `seen`: rows x |F|.
  void add_trace(const RowMatrix& x_seen, RowMatrix& w_F) const;
};

/// Whether M_FF is regular beyond rounding, and not larger than elimination takes.
bool can_eliminate_free(const Scene&);

/// Empty if M_FF is singular to rounding or has more than 4096 rows. Kronecker sums are converted to matrices, dense
/// ones up to 1024 states. Precondition: a valid scene with free rows and initial values.
std::optional<EliminatedScene> eliminate_free(const Scene&);

/// The scene of the second argument in the place of the first. y, its rounding error, trace and residual of a solve are
/// those of all rows, the free ones included. On one grid: options.tolerance is 0.
Reduction without_free_rows(const Scene&, const std::shared_ptr<const EliminatedScene>&, const InnerOptions&);

}  // namespace bromwich
