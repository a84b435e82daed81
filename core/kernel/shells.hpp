#pragma once
// Fewer exponentials for the modes with a short memory. A recurrence has the same rates s_k for all modes, mode l
// decays with s_k + mu_l. For a fast mu_l the kernel is needed on a few steps alone, where few of the rates already
// span all others. Modes are taken in groups of neighbours; each group keeps the rates that it needs, in its first
// rows. A group of two families (ModalRecurrence::families) keeps all.

#include "../seam/recurrence.hpp"

#include <vector>

namespace bromwich {

struct Shells {
  ModalRecurrence recurrence;  ///< rows from `counts` on are zero in a group; weights of the given one to `error`
  std::vector<Index> counts;   ///< exponentials of each group
  double error = 0;            ///< at the sample times of the fits, relative to the largest |W_d|, d >= 1, of a group
};

/// `together`: modes of a group; counts are multiples of `rounding`, as far as there are as many exponentials. For a
/// recurrence of the exponential rule without `initial`, on `steps` steps.
Shells in_shells(const ModalRecurrence&, Index steps, Index together, Index rounding);

}  // namespace bromwich
