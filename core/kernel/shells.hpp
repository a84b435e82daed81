#pragma once
// Fewer exponentials for the modes with a short memory. A recurrence has the same rates s_k for all modes, mode l
// decays with s_k + mu_l. For a fast mu_l the kernel is needed on a few steps alone, where few of the rates already
// span all others. Modes are taken in groups of neighbours; each group keeps the rates that it needs, in its first
// rows. A group of two families (ModalRecurrence::families) keeps all.

#include "../base/threads.hpp"
#include "../seam/recurrence.hpp"

#include <vector>

namespace bromwich {

/// Σ_k c_k e^{x_k t} for t from 1 to the number of steps, with fewer of the rates.
struct ShellFit {
  std::vector<Index> order;  ///< of the rates that are kept
  Vector factors;            ///< their new coefficients over the old ones
  double error = 0;          ///< at times between the samples, relative to the largest value
};

struct Shells {
  Index together = 1;           ///< modes of a group
  std::vector<ShellFit> fits;   ///< the first one keeps all rates
  std::vector<Index> of_group;  ///< the fit of each group
  double error = 0;             ///< the largest one of a fit

  const ShellFit& of(Index group) const { return fits[std::size_t(of_group[std::size_t(group)])]; }
  Index kept(Index group) const { return Index(of(group).order.size()); }
};

/// `together`: modes of a group; numbers of rates are multiples of `rounding`, as far as there are as many. For a
/// recurrence of the exponential rule without `initial`, on `steps` steps.
Shells find_shells(const HostThreads&, const ModalRecurrence&, Index steps, Index together, Index rounding);

/// The recurrence with them: rows of a group behind those that it keeps are zero. The weights W_d are those of the
/// given one to `error`, relative to the largest |W_d|, d >= 1, of a group.
ModalRecurrence in_shells(const ModalRecurrence&, const Shells&);

}  // namespace bromwich
