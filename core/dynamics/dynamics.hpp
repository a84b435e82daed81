#pragma once
// Linear dynamics E x' = A x + B y and their output to the constraints, N x. E has to be regular; by default it is the
// identity.

#include "dense.hpp"
#include "kronecker.hpp"
#include "linear_system.hpp"
#include "sparse.hpp"
#include "spectrum.hpp"
#include "supplied.hpp"

#include <concepts>
#include <memory>
#include <utility>

namespace bromwich {

/// A struct is a kind of dynamics if `linear_system` makes a LinearSystem from it.
template <class Kind>
concept DynamicsKind = requires(Kind values) {
  { linear_system(std::move(values)) } -> std::same_as<std::shared_ptr<LinearSystem>>;
};

/// Dynamics of any kind, a value. Copies share the matrices until one of them is changed.
class Dynamics {
 public:
  Dynamics() : Dynamics(DenseDynamics{}) {}
  template <DynamicsKind Kind>
  Dynamics(Kind values) : system_(linear_system(std::move(values))) {}
  /// Any other implementation; it must not change afterwards.
  explicit Dynamics(std::shared_ptr<LinearSystem> system) : system_(std::move(system)) {}

  Dynamics(const Dynamics& other) : system_(other.copied()) {}
  Dynamics(Dynamics&&) = default;
  Dynamics& operator=(const Dynamics& other) { return *this = Dynamics(other); }
  Dynamics& operator=(Dynamics&&) = default;
  ~Dynamics() = default;

  const LinearSystem& operator*() const { return *system_; }
  const LinearSystem* operator->() const { return system_.get(); }

  /// The struct from which these dynamics were made, or null if it was one of another kind. For code that makes or
  /// shows scenes; methods ask for capabilities.
  template <DynamicsKind Kind>
  const Kind* made_from() const {
    const auto* system = dynamic_cast<const SystemOf<Kind>*>(system_.get());
    return system ? &system->d : nullptr;
  }
  /// The same, to change values. Copies of the dynamics keep theirs.
  template <DynamicsKind Kind>
  Kind* made_from() {
    auto* system = dynamic_cast<SystemOf<Kind>*>(system_.get());
    if (!system) return nullptr;
    if (system_.use_count() > 1) {
      system_ = linear_system(system->d);
      system = static_cast<SystemOf<Kind>*>(system_.get());
    }
    copy_ = [](const LinearSystem& given) { return linear_system(static_cast<const SystemOf<Kind>&>(given).d); };
    return &system->d;
  }

 private:
  std::shared_ptr<LinearSystem> copied() const { return copy_ ? copy_(*system_) : system_; }

  std::shared_ptr<LinearSystem> system_;
  std::shared_ptr<LinearSystem> (*copy_)(const LinearSystem&) = nullptr;  ///< set once values may be changed
};

template <DynamicsKind Kind>
bool holds(const Dynamics& dynamics) {
  return dynamics.made_from<Kind>() != nullptr;
}
template <DynamicsKind Kind>
const Kind* get_if(const Dynamics* dynamics) {
  return dynamics->made_from<Kind>();
}
template <DynamicsKind Kind>
Kind* get_if(Dynamics* dynamics) {
  return dynamics->made_from<Kind>();
}
/// Throws Error if the dynamics were made from a struct of another kind.
template <DynamicsKind Kind>
const Kind& get(const Dynamics& dynamics) {
  if (const Kind* values = get_if<Kind>(&dynamics)) return *values;
  throw Error("dynamics", "are of another kind", "ask with holds<Kind>(dynamics) first");
}
template <DynamicsKind Kind>
Kind& get(Dynamics& dynamics) {
  if (Kind* values = get_if<Kind>(&dynamics)) return *values;
  throw Error("dynamics", "are of another kind", "ask with holds<Kind>(dynamics) first");
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
