#pragma once
// NumPy arrays and what the library computes with. The Python layer hands over arrays of float64 that are C-contiguous;
// they are copied once, since a scene outlives them. Results go the other way without a copy.

#include "core/base/error.hpp"
#include "core/base/types.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

namespace bromwich::python {

namespace nb = nanobind;

using Array1 = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Array2 = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Indices = nb::ndarray<const int, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using View = nb::ndarray<nb::numpy, const double>;

inline Eigen::Map<const Vector> as_vector(const Array1& a) { return {a.data(), Index(a.shape(0))}; }

inline Eigen::Map<const RowMatrix> as_matrix(const Array2& a) {
  return {a.data(), Index(a.shape(0)), Index(a.shape(1))};
}

/// Of compressed columns, the rows of each in ascending order. Throws Error where they leave the matrix.
inline SparseMatrix as_sparse(Index rows, Index cols, const Array1& values, const Indices& row, const Indices& start) {
  const int *rows_of = row.data(), *starts = start.data();
  const Index entries = Index(values.shape(0));
  bool held = rows >= 0 && cols >= 0 && Index(row.shape(0)) == entries && Index(start.shape(0)) == cols + 1 &&
              starts[0] == 0 && starts[cols] == entries;
  for (Index j = 0; held && j < cols; ++j) held = starts[j] <= starts[j + 1] && starts[j + 1] <= entries;
  for (Index j = 0; held && j < cols; ++j)
    for (int k = starts[j]; held && k < starts[j + 1]; ++k)
      held = rows_of[k] > (k == starts[j] ? -1 : rows_of[k - 1]) && rows_of[k] < rows;
  if (!held) throw Error("matrix", "its compressed columns are inconsistent", "give ascending rows within the matrix");
  return Eigen::Map<const SparseMatrix>(rows, cols, Index(values.shape(0)), start.data(), row.data(), values.data());
}

/// A read-only view that keeps its owner alive.
inline View view(const Vector& v, nb::handle owner) { return View(v.data(), {std::size_t(v.size())}, owner); }

inline View view(const RowMatrix& m, nb::handle owner) {
  return View(m.data(), {std::size_t(m.rows()), std::size_t(m.cols())}, owner);
}

}  // namespace bromwich::python
