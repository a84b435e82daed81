#include "core/dynamics/dynamics.hpp"

namespace bromwich {

// For programs, which see the public header alone.
template const DenseDynamics* Dynamics::made_from() const;
template const SparseDynamics* Dynamics::made_from() const;
template const KroneckerDynamics* Dynamics::made_from() const;
template const SuppliedDynamics* Dynamics::made_from() const;
template DenseDynamics* Dynamics::made_from();
template SparseDynamics* Dynamics::made_from();
template KroneckerDynamics* Dynamics::made_from();
template SuppliedDynamics* Dynamics::made_from();

}  // namespace bromwich
