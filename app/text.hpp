#pragma once
// Text helpers of the command: formatted quantities, in addition to files/words.hpp.

#include "files/words.hpp"

#include <string>

namespace bromwich::app {

/// "12.3 ms", with a unit that keeps three digits.
std::string format_seconds(double seconds);

/// "12.3 MB" (powers of 1000).
std::string format_bytes(double bytes);

}  // namespace bromwich::app
