#pragma once

#include "../base/threads.hpp"
#include "../dynamics/dynamics.hpp"

namespace bromwich::host {

ComplexMatrix sparse_shifted_solves(const SparseDynamics&, const ComplexVector& nodes, const HostThreads&);

}  // namespace bromwich::host
