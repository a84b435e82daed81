#pragma once
// NumPy arrays and what the library computes with. The Python layer hands over arrays of float64 that are C-contiguous;
// they are copied once, since a scene outlives them. Results go the other way without a copy.

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

/// Of compressed columns as SciPy has them.
inline SparseMatrix as_sparse(Index rows, Index cols, const Array1& values, const Indices& row, const Indices& start) {
  return Eigen::Map<const SparseMatrix>(rows, cols, Index(values.shape(0)), start.data(), row.data(), values.data());
}

/// A read-only view that keeps its owner alive.
inline View view(const Vector& v, nb::handle owner) { return View(v.data(), {std::size_t(v.size())}, owner); }

inline View view(const RowMatrix& m, nb::handle owner) {
  return View(m.data(), {std::size_t(m.rows()), std::size_t(m.cols())}, owner);
}

}  // namespace bromwich::python
