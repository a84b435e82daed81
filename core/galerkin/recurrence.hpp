#pragma once
// The discrete Galerkin problem in the form of core/seam/recurrence.hpp, for the operations of a backend. Row j of an
// array belongs to interval j, and row 0 is not used. The state z_j of the recurrence is x_j.

#include "../seam/backend.hpp"
#include "discretisation.hpp"

namespace bromwich {

/// v_j = C z_{j-1}, z_j = E z_{j-1} + H y_j: the contribution of the intervals before j to w_j.
inline Recurrence galerkin_recurrence(const GalerkinStep& s) {
  const Index m = s.E.rows(), n = s.D.rows();
  return DenseRecurrence{s.E, s.H, Matrix::Zero(m, n), s.C, Matrix::Zero(n, n)};
}

/// An array of N+1 rows with `values` (N rows) below a row of zeros.
inline std::unique_ptr<Array> padded_array(const RowMatrix& values, Backend& backend) {
  RowMatrix rows = RowMatrix::Zero(values.rows() + 1, values.cols());
  rows.bottomRows(values.rows()) = values;
  auto array = backend.array(rows.rows(), rows.cols());
  backend.upload(rows, *array);
  return array;
}

}  // namespace bromwich
