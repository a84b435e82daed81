#pragma once
// What methods ask of Dynamics.

#include "bromwich/dynamics.hpp"
#include "dense.hpp"
#include "kronecker.hpp"
#include "linear_system.hpp"
#include "sparse.hpp"
#include "spectrum.hpp"
#include "supplied.hpp"

#include <utility>

namespace bromwich {

template <DynamicsKind Kind>
const Kind* Dynamics::made_from() const {
  const auto* system = dynamic_cast<const SystemOf<Kind>*>(system_.get());
  return system ? &system->d : nullptr;
}
template <DynamicsKind Kind>
Kind* Dynamics::made_from() {
  auto* system = dynamic_cast<SystemOf<Kind>*>(system_.get());
  if (!system) return nullptr;
  if (system_.use_count() > 1) {
    system_ = linear_system(system->d);
    system = static_cast<SystemOf<Kind>*>(system_.get());
  }
  copy_ = [](const LinearSystem& given) { return linear_system(static_cast<const SystemOf<Kind>&>(given).d); };
  return &system->d;
}

inline Index states(const Dynamics& d) { return d->states(); }
inline Index constraints(const Dynamics& d) { return d->constraints(); }

/// A, B, N and E as dense matrices, for small scenes and as an oracle. Throws Error above 4096 states, and where A is
/// known by its solves alone.
inline DenseDynamics to_dense(const Dynamics& d) {
  if (const auto dense = d->dense_form()) return *dense;
  throw Error("dynamics", "are known by their solves alone", "give A, B and N as matrices if a dense form is needed");
}

/// Exact for a Kronecker sum (sine eigenvalues); all eigenvalues by the QR algorithm for dense A and for sparse A with
/// at most 256 states. Larger sparse A: bounds and estimates, `abscissa` at least 0 and `slowest` not known (0).
inline Spectrum spectrum(const Dynamics& d) { return d->spectrum(); }

/// N x for one state.
inline Vector observe(const Dynamics& d, const Vector& x) { return d->observe(x); }

}  // namespace bromwich
