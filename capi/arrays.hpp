#pragma once
// Arrays and words of a caller as those of the library.

#include "capi/handles.hpp"

#include <string>

namespace bromwich::capi {

/// A copy of rows x columns values. Throws Error naming `name`.
Matrix matrix_from(const double* values, Index rows, Index columns, int order, const std::string& name);

/// "P", "Z", "PSD" or "unknown"; NULL: it is tested.
LcpClass class_of(const char* name);

/// The breakpoints of the scene: those as it was read or as they were set, of f and of g.
void merge_kinks(bromwich_scene&);

/// What a caller gets of an array that a handle owns.
struct HandedOver {
  const double* values;
  Index rows, columns;

  explicit HandedOver(const RowMatrix& a) : values(a.data()), rows(a.rows()), columns(a.cols()) {}
  explicit HandedOver(const Vector& a) : values(a.data()), rows(a.size()), columns(1) {}
};
/// `rows` and `columns` may be null.
void hand_over(const HandedOver&, const double** values, int64_t* rows, int64_t* columns);

}  // namespace bromwich::capi
