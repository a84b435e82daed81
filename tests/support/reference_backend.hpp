#pragma once
// A backend of naive loops with the required operations only. It is slow and meant to be read. The contract tests
// compare it and the fast backends with the same answers.

#include "core/seam/backend.hpp"

#include <memory>

namespace bromwich {

/// `traits`: what it says of its costs.
std::unique_ptr<Backend> make_reference_backend(const BackendTraits& traits = {});

}  // namespace bromwich
