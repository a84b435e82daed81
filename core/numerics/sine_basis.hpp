#pragma once

#include "../base/types.hpp"

namespace bromwich {

/// S_ik = sqrt(2/(n+1)) sin(pi i k/(n+1)), n x n: symmetric, orthonormal.
Matrix sine_matrix(Index n);
/// S v by a sum over the nonzero entries of v; b and n of a line have few.
Vector in_sine_basis(const Vector& v);

}  // namespace bromwich
