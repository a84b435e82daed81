#pragma once
// What scans precompute on the host: powers of decays.

#include "core/base/types.hpp"

namespace bromwich::cuda {

/// base^exponent, entry by entry, for exponent >= 1, by repeated squaring: about 2 log2(exponent) products of arrays,
/// which the compiler vectorises, for a call of pow an entry. To first order the relative error is at most
/// (exponent - 1) eps / 2, less than what one rounding of the base makes of it.
inline RowMatrix entry_powers(RowMatrix base, Index exponent) {
  RowMatrix power = RowMatrix::Ones(base.rows(), base.cols());
  for (; exponent > 0; exponent /= 2) {
    if (exponent % 2 == 1) power.array() *= base.array();
    if (exponent > 1) base.array() *= base.array().eval();
  }
  return power;
}

}  // namespace bromwich::cuda
