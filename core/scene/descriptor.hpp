#pragma once
// The pencil s E - A of a descriptor system E x' = A x + ...: whether E is regular, and the kind of the system if it is
// not. Rows and columns are scaled first, so that units do not matter.

#include "../base/types.hpp"

#include <string>

namespace bromwich {

bool is_diagonal(const SparseMatrix&);

/// Positive R and C with the largest entry of every row and column of R X C near 1; 1 for zero rows and columns.
struct DescriptorUnits {
  Vector rows, columns;
  SparseMatrix scaled(const SparseMatrix& X) const;  ///< R X C
};
DescriptorUnits units_of(const SparseMatrix& X);

/// Estimate of 1/(||X||_1 ||X^{-1}||_1) from sparse factors (Hager, Higham); 0 where they do not exist.
double reciprocal_condition(const SparseMatrix& X);

/// In such units X has a reciprocal condition above m eps; of a diagonal X: no zero on the diagonal.
bool is_regular(const SparseMatrix& X);

/// Describes a singular E: its rank, and whether the system has index 1 (the algebraic part can be solved), index 2 or
/// more, or a singular pencil. det(s E - A) is 0 for all s then, and no initial value has exactly one solution. Above
/// 512 rows their number alone.
std::string describe_singular(const SparseMatrix& E, const SparseMatrix& A);

}  // namespace bromwich
