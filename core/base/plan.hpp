#pragma once

#include <cstddef>

namespace bromwich {

/// An operation that was prepared, with its workspace.
class Plan {
 public:
  Plan() = default;
  virtual ~Plan() = default;
  Plan(const Plan&) = delete;
  Plan& operator=(const Plan&) = delete;
  /// Of its workspace, in the memory where it runs.
  virtual std::size_t bytes() const = 0;
};

}  // namespace bromwich
