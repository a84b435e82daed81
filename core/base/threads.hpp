#pragma once

#include "types.hpp"

#include <algorithm>
#include <exception>
#include <functional>
#include <mutex>

namespace bromwich {

/// Host threads that share work on host values. This class has the calling thread only.
class HostThreads {
 public:
  virtual ~HostThreads() = default;
  /// Number of threads, the calling thread included.
  virtual int threads() const { return 1; }
  /// Calls body(first, last) for ranges first <= i < last that partition 0 <= i < count, in any order and concurrently.
  /// Ranges have `length` indices, the last one the remainder. The body must not throw.
  virtual void each_range(Index count, Index length, const std::function<void(Index first, Index last)>& body) const {
    for (Index first = 0; first < count; first += length) body(first, std::min(first + length, count));
  }
};

/// The same for a body that may throw: the first exception is rethrown after all ranges have ended.
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

/// use(i) for 0 <= i < count, as `share` with ranges of one index.
inline void share_each(const HostThreads& threads, Index count, const std::function<void(Index)>& use) {
  share(threads, count, 1, [&](Index first, Index) { use(first); });
}

}  // namespace bromwich
