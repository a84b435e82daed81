#pragma once

#include "../base/types.hpp"

#include <vector>

namespace bromwich {

/// S_ik = sqrt(2/(n+1)) sin(pi i k/(n+1)), n x n: symmetric, orthonormal.
Matrix sine_matrix(Index n);
/// The Kronecker product of the sine matrices of several directions, the fastest last.
Matrix face_sine_matrix(const std::vector<Index>& extents);
/// `values` <- S values for a vector that is indexed by these directions: one product for each of them.
void to_face_modes(const std::vector<Index>& extents, double* values);

/// S v by a sum over the nonzero entries of v; b and n of a line have few.
Vector in_sine_basis(const Vector& v);

}  // namespace bromwich
