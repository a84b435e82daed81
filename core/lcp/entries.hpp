#pragma once
// Facts of a complementarity matrix from its stored entries. A sparse M is never written out.

#include "matrix.hpp"

namespace bromwich {

/// Whether every entry is 0.
bool is_zero(const LcpMatrix&);

/// Whether M is invertible up to rounding: by pivots of a dense M, by a factorization that finds a known solution of
/// others.
bool is_regular(const LcpMatrix&);

}  // namespace bromwich
