#pragma once
// The matrices of a scene file in the form in which core stores them: dense, sparse, tridiagonal, or a rectangle of
// grid points.

#include "core/dynamics/rectangle.hpp"
#include "core/scene/scene.hpp"
#include "files/sections.hpp"

namespace bromwich {

SparseMatrix sparse_value(const MatrixValue&);
/// Throws Error that names `where` if the matrix is too large to be dense.
Matrix dense_value(const MatrixValue&, const std::string& where);

inline constexpr Index largest_dense = 4096;       ///< states; a dense A then takes 128 MiB
inline constexpr Index smallest_tridiagonal = 17;  ///< constraints from which a tridiagonal M is stored as diagonals

/// `smallest`: number of rows from which a tridiagonal matrix is stored as diagonals.
LcpMatrix lcp_matrix(const MatrixValue&, const std::string& where, Index smallest = smallest_tridiagonal);

/// A, B, N and E, or those of the rectangle. It stays as KeptValues says, as the rectangle does.
const Dynamics& read_dynamics(const Sections&);

/// Whether the file has neither y nor w: no [complementarity] and no B.
bool without_pairs(const Sections&);

/// A rectangle whose first direction is along the side of the constraints, or a line.
const Rectangle& read_rectangle(const Sections&);
/// M of one side is that of both sides of a rectangle with two.
MatrixValue of_each_side(MatrixValue M, const Rectangle&, const std::string& where);

}  // namespace bromwich
