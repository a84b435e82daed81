#pragma once

#include <cstddef>

namespace bromwich {

/// A prepared operation with its workspace.
class Plan {
 public:
  Plan() = default;
  virtual ~Plan() = default;
  Plan(const Plan&) = delete;
  Plan& operator=(const Plan&) = delete;
  /// Bytes of the workspace, in the memory where the operation runs.
  virtual std::size_t bytes() const = 0;
};

}  // namespace bromwich
