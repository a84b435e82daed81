#pragma once

#include "../base/threads.hpp"
#include "../dynamics/dynamics.hpp"

namespace bromwich {

/// N (z_p E - A)^{-1} B for all nodes z_p at once. Row p of the result holds the n modal values (Kronecker sum), or the
/// n x k entries of the matrix, row by row (otherwise; N and B may have any shape that fits A). Throws SingularShift if
/// a node is an eigenvalue.
ComplexMatrix shifted_solves(const Dynamics&, const ComplexVector& nodes, const HostThreads&);

}  // namespace bromwich
