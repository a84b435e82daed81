#pragma once

#include "../result/options.hpp"
#include "../result/result.hpp"
#include "changes.hpp"

namespace bromwich {

/// A method with everything made that does not depend on x0, f and g: weights, plans, arrays.
class PreparedMethod {
 public:
  virtual ~PreparedMethod() = default;
  /// Takes x0, f and g anew, after the problem of its operator has got others.
  virtual void renew(const Changes&) = 0;
  /// Fills everything of the result but the states and times of the whole.
  virtual void run(const Options&, Result&) = 0;
};

}  // namespace bromwich
