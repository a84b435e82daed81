#pragma once

#include "types.hpp"

#include <algorithm>
#include <functional>

namespace bromwich {

/// Host threads that divide work on host data. This base class uses the calling thread only.
class HostThreads {
 public:
  virtual ~HostThreads() = default;
  /// Calls body(first, last) for consecutive ranges first <= i < last of 0 <= i < count, each of `length` numbers (the
  /// last one may be shorter), in any order and concurrently. The body must not throw.
  virtual void each_range(Index count, Index length, const std::function<void(Index first, Index last)>& body) const {
    for (Index first = 0; first < count; first += length) body(first, std::min(first + length, count));
  }
};

}  // namespace bromwich
