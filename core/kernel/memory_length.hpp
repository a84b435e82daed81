#pragma once
// How far back a mode remembers. Weights that decay are soon lost in the rounding of their sum: where E is the slowest
// exponential of a mode, about 37/|log E| lags count, and a convolution with few of them is a sum of few terms.

#include "recurrence.hpp"

#include <vector>

namespace bromwich {

/// Lags D <= J of each mode beyond which all weights together are less than a rounding of the kernel:
///
///     Σ_{d > D} |W_d|, Σ_{d > D} |S_d|  <=  |E|^D Σ_k |C_k| max(1, |G0_k|) / (1 - |E_k|)
///                                       <=  eps max(|W_0|, |Σ_d W_d|),
///
/// eps = 2^-53, |E| = max_k |E_k|. At least 1, as lag 1 carries w1 and s1; J where an exponential does not decay, or
/// where there is an `initial`.
std::vector<Index> memory_lengths(const ModalRecurrence&, Index J);

}  // namespace bromwich
