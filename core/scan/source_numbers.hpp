#pragma once
// The sources of all steps by few numbers in each: columns that are constant, or a multiple of another one up to a
// constant, are maps of the others.

#include "../base/types.hpp"

namespace bromwich {

/// Row j of a table is constant + of numbers_j, for j >= 1.
struct SourceNumbers {
  RowMatrix numbers;  ///< J+1 rows
  Vector constant;    ///< a column of the table each
  Matrix of;          ///< columns of the table x numbers
};

SourceNumbers source_numbers(const RowMatrix& table);

}  // namespace bromwich
