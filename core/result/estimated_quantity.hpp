#pragma once

#include "result.hpp"

namespace bromwich {

/// What Result::error_estimate is the error of, in words: "y and x", "the mean of y over [0, t]"; empty where there is
/// no estimate.
std::string estimated_quantity(const Result&);

}  // namespace bromwich
