#pragma once

#include "matrix.hpp"

#include <optional>

namespace bromwich {

/// An upper bound of L, the Lipschitz constant of SOL(M, .) for a P-matrix. n <= 12: L itself (infinite if some M_SS is
/// singular to rounding). Larger n: the smaller of ||<M>^{-1}||_inf (H+) and sqrt(n) / lambda_min of the symmetric part
/// (positive definite; ||M_SS^{-1}||_2 <= 1 / lambda_min); otherwise infinite.
double solution_lipschitz(const LcpMatrix&);

/// <M>^{-1} >= |M_SS^{-1}| entry by entry, for H+ and n <= 2048; otherwise nothing.
std::optional<Matrix> inverse_comparison(const LcpMatrix&);

}  // namespace bromwich
