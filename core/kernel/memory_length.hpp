#pragma once
// Memory length of a mode. Decaying weights soon fall below the rounding error of their sum. With the slowest
// exponential E of a mode, about 37/|log E| lags matter. A convolution with few such lags is a direct sum.

#include "recurrence.hpp"

#include <vector>

namespace bromwich {

/// For each mode the number of lags D <= J after which all weights together are below the rounding error of the kernel:
///
///     Σ_{d > D} |W_d|, Σ_{d > D} |S_d|  <=  |E|^D Σ_k |C_k| max(1, |G0_k|) / (1 - |E_k|)
///                                       <=  eps max(|W_0|, |Σ_d W_d|),
///
/// eps = 2^-53, |E| = max_k |E_k|. D >= 1, as lag 1 carries w1 and s1. D = J if an exponential does not decay, or if
/// there is an `initial`.
std::vector<Index> memory_lengths(const ModalRecurrence&, Index J);

}  // namespace bromwich
