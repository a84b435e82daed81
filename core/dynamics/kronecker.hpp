#pragma once

#include "bromwich/dynamics.hpp"
#include "linear_system.hpp"
#include "second_difference.hpp"

#include <vector>

namespace bromwich {

/// The Kronecker sum as sparse matrices, at any size.
SparseDynamics to_sparse(const KroneckerDynamics&);

}  // namespace bromwich
