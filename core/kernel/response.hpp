#pragma once
// The part of w that does not depend on y, r(t) = N e^{At} x0 + ∫_0^t N e^{A(t-s)} f(s) ds + g(t), and x.

#include "../numerics/face_basis.hpp"
#include "../seam/backend.hpp"
#include "recurrence.hpp"
#include "step_defects.hpp"

namespace bromwich {

/// Every row, values at the points of a face or coefficients of its modes, transformed.
RowMatrix transformed(Backend&, const FaceBasis&, const RowMatrix& rows, Way);

/// Rows of positions on a line across in its modes, and back.
RowMatrix in_line_modes(Backend&, const SecondDifference& across, const RowMatrix& lines);
RowMatrix from_line_modes(Backend&, const SecondDifference& across, const RowMatrix& modes);

/// x0 in modes, along the face only (`both` = false) or across it too: n x across.points. Of two faces: its views.
RowMatrix x0_in_modes(Backend&, const KroneckerDynamics&, const Vector& x0, bool both);

/// x_j of x' = A x + u, (J+1) x m, row 0 = x0. u is piecewise linear on the grid (exponential) or sampled at the right
/// ends (Euler), with u_j = B y_j + f_j in R^m plus the defects of single steps.
RowMatrix dense_states(const StepOperators&, const Vector& x0, const RowMatrix& u, const StepDefects* = nullptr);

}  // namespace bromwich
