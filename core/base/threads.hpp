#pragma once

#include "types.hpp"

#include <algorithm>
#include <exception>
#include <functional>
#include <mutex>

namespace bromwich {

/// Threads of the host that share work on values of the host. This class has the calling thread alone.
class HostThreads {
 public:
  virtual ~HostThreads() = default;
  /// How many there are, the calling thread included.
  virtual int threads() const { return 1; }
  /// body(first, last) for the ranges first <= i < last that make up 0 <= i < count, in any order and at the same time.
  /// Each has `length` numbers, the last one what is left. The body must not throw.
  virtual void each_range(Index count, Index length, const std::function<void(Index first, Index last)>& body) const {
    for (Index first = 0; first < count; first += length) body(first, std::min(first + length, count));
  }
};

/// The same for a body that may throw: the first exception is thrown again when all ranges have ended.
inline void share(const HostThreads& threads, Index count, Index length,
                  const std::function<void(Index first, Index last)>& body) {
  std::exception_ptr failure;
  std::mutex mutex;
  threads.each_range(count, length, [&](Index first, Index last) {
    try {
      body(first, last);
    } catch (...) {
      const std::lock_guard lock(mutex);
      if (!failure) failure = std::current_exception();
    }
  });
  if (failure) std::rethrow_exception(failure);
}

/// use(i) for 0 <= i < count, one at a time.
inline void share_each(const HostThreads& threads, Index count, const std::function<void(Index)>& use) {
  share(threads, count, 1, [&](Index first, Index) { use(first); });
}

}  // namespace bromwich
