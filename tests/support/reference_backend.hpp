#pragma once
// A backend of naive loops. It has the required operations alone, and includes installed headers alone
// (tests/consumer builds it outside of the project). It is slow and meant to be read: the contract tests hold it and
// the fast backends to the same answers.

#ifdef BROMWICH_INSTALLED
#include <bromwich/core/seam/backend.hpp>
#else
#include "core/seam/backend.hpp"
#endif

#include <memory>

namespace bromwich {

std::unique_ptr<Backend> make_reference_backend();

}  // namespace bromwich
