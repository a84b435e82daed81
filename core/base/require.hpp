#pragma once
// Checks of the input: each throws an Error that names the argument, the value found and the remedy.

#include "error.hpp"
#include "text.hpp"
#include "types.hpp"

#include <cmath>
#include <string>

namespace bromwich {

template <typename Found>
void require_shape(const std::string& member, const Found& found, Index rows, Index cols, const std::string& meaning) {
  const auto shape = [](Index r, Index c) { return std::to_string(r) + " x " + std::to_string(c); };
  if (found.rows() != rows || found.cols() != cols)
    throw Error(member, "is " + shape(found.rows(), found.cols()), "make it " + meaning + " = " + shape(rows, cols));
}

inline void require_length(const std::string& member, const Vector& found, Index length, const std::string& meaning) {
  if (found.size() != length)
    throw Error(member, "has " + std::to_string(found.size()) + " entries",
                "give " + std::to_string(length) + ", " + meaning);
}

inline void require_some(const std::string& member, Index count, const std::string& what) {
  if (count < 1) throw Error(member, "has no " + what, "give at least one");
}

inline void require_positive(const std::string& member, double value) {
  if (!(value > 0) || !std::isfinite(value))
    throw Error(member, "is " + text("%g", value), "give a positive finite number");
}

template <typename Derived>
void require_finite(const std::string& member, const Eigen::DenseBase<Derived>& values) {
  if ((0 * values.derived().array()).sum() == 0) return;  // neither NaN nor infinite; vectorised
  for (Index j = 0; j < values.cols(); ++j)
    for (Index i = 0; i < values.rows(); ++i)
      if (const double value = values(i, j); !std::isfinite(value)) {
        const std::string where = values.cols() == 1 ? std::to_string(i) : std::to_string(i) + "," + std::to_string(j);
        throw Error(member, "entry (" + where + ") is " + text("%g", value), "make every entry finite");
      }
}

inline void require_finite(const std::string& member, const SparseMatrix& values) {
  for (Index j = 0; j < values.outerSize(); ++j)
    for (SparseMatrix::InnerIterator entry(values, j); entry; ++entry)
      if (!std::isfinite(entry.value()))
        throw Error(
            member,
            "entry (" + std::to_string(entry.row()) + "," + std::to_string(j) + ") is " + text("%g", entry.value()),
            "make every entry finite");
}

}  // namespace bromwich
