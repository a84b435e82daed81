#pragma once
// Values that change their sign from row to row.

#include "../base/types.hpp"

namespace bromwich {

/// Largest absolute value of each column in the rows begin .. end-1 of y, or what `largest` holds already.
void largest_of_columns(const RowMatrix& y, Index begin, Index end, Vector& largest);

/// Whether some column alternates over `run` rows that end in one of the rows begin .. end-1 (Backend::alternates),
/// with second differences above least[column].
bool alternates(const RowMatrix& y, Index begin, Index end, const Vector& least, Index run);

}  // namespace bromwich
