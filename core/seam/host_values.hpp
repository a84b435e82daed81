#pragma once

#include "array.hpp"

namespace bromwich {

/// What a backend is derived from too, if its arrays lie in the memory of the host.
class HostValues {
 public:
  virtual ~HostValues() = default;
  /// Row by row, without gaps.
  virtual double* values(Array&) const = 0;
};

}  // namespace bromwich
