#pragma once

#include "matrix.hpp"

#include <optional>

namespace bromwich {

/// An upper bound of L, the Lipschitz constant of SOL(M, .) for a P-matrix: L itself for n <= 12 (infinite where some
/// M_SS is singular to rounding); above, the smaller of ||<M>^{-1}||_inf (H+) and sqrt(n) / lambda_min of the symmetric
/// part (positive definite; ||M_SS^{-1}||_2 <= 1 / lambda_min); else infinite.
double solution_lipschitz(const LcpMatrix&);

/// <M>^{-1} >= |M_SS^{-1}| entry by entry, for H+ and n <= 2048; otherwise nothing.
std::optional<Matrix> inverse_comparison(const LcpMatrix&);

}  // namespace bromwich
