#pragma once

#include "../result/options.hpp"
#include "../result/result.hpp"
#include "changes.hpp"

namespace bromwich {

/// A method with everything that does not depend on x0, f and g: weights, plans, arrays.
class PreparedMethod {
 public:
  virtual ~PreparedMethod() = default;
  /// Reads x0, f and g again, after they have changed in the problem of its operator.
  virtual void renew(const Changes&) = 0;
  /// Fills the result except for the states and the total times.
  virtual void run(const Options&, Result&) = 0;
};

}  // namespace bromwich
