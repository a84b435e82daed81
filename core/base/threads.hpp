#pragma once

#include "types.hpp"

#include <algorithm>
#include <functional>

namespace bromwich {

/// Threads of the host that share out work on values of the host. This one has the calling thread alone.
class HostThreads {
 public:
  virtual ~HostThreads() = default;
  /// body(first, last) for the ranges first <= i < last of `length` numbers, the last one of what is left, that make up
  /// 0 <= i < count, in any order and at the same time. The body must not throw.
  virtual void each_range(Index count, Index length, const std::function<void(Index first, Index last)>& body) const {
    for (Index first = 0; first < count; first += length) body(first, std::min(first + length, count));
  }
};

}  // namespace bromwich
