#pragma once
// A backend of naive loops with the required operations only. It includes installed headers only; tests/consumer builds
// it outside of the project. It is slow and meant to be read. The contract tests compare it and the fast backends with
// the same answers.

#ifdef BROMWICH_INSTALLED
#include <bromwich/core/seam/backend.hpp>
#else
#include "core/seam/backend.hpp"
#endif

#include <memory>

namespace bromwich {

/// `traits`: what it says of its costs.
std::unique_ptr<Backend> make_reference_backend(const BackendTraits& traits = {});

}  // namespace bromwich
