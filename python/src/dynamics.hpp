#pragma once
// Dynamics that a Python program supplies by what they do.

#include "callable.hpp"
#include "core/dynamics/dynamics.hpp"

namespace bromwich::python {

/// `shifted`: z -> a callable R -> X that solves (zE - A) X = R, complex arrays m x k; `mass`: X -> E X, or empty. They
/// are called from the thread that solves. bromwich.SingularShift, numpy.linalg.LinAlgError and a RuntimeError about a
/// singular matrix say that z is an eigenvalue; every other exception leaves `solve`.
SuppliedDynamics supplied_dynamics(Index states, SparseMatrix B, SparseMatrix N, Kept shifted, Kept mass,
                                   std::optional<SpectralBound> bound);

}  // namespace bromwich::python
