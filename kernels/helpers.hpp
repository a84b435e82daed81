#pragma once
// Threads that sleep until there is something to share, for work of less than a millisecond: nobody waits for one that
// wakes up late. The teams of OpenMP end together, so that the slowest to wake decides.

#include <condition_variable>
#include <functional>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace bromwich {

class Helpers {
 public:
  /// None are made before the first `share`.
  explicit Helpers(int count) : count_(count) {}
  ~Helpers() {
    {
      const std::lock_guard lock(mutex_);
      ending_ = true;
    }
    begun_.notify_all();
  }
  Helpers(const Helpers&) = delete;
  Helpers& operator=(const Helpers&) = delete;

  /// Calls `first`, then `work`, by this thread; `work` by the others too, as soon as they are there. `work` returns
  /// when nothing is left to be begun; who comes later does not call it any more. Returns when all calls have. Neither
  /// may throw.
  void share(const std::function<void()>& work, const std::function<void()>& first) {
    {
      const std::lock_guard lock(mutex_);
      try {
        while (int(threads_.size()) < count_) threads_.emplace_back([this] { help(); });
      } catch (const std::system_error&) {
        count_ = int(threads_.size());  // as many as there may be
      }
      work_ = &work;
      ++number_;
    }
    begun_.notify_all();
    first();
    work();
    std::unique_lock lock(mutex_);
    work_ = nullptr;
    ended_.wait(lock, [this] { return at_work_ == 0; });
  }

 private:
  void help() {
    std::unique_lock lock(mutex_);
    for (unsigned long done = 0; !ending_;) {
      begun_.wait(lock, [&] { return ending_ || (work_ && number_ != done); });
      if (ending_) return;
      done = number_;
      const std::function<void()>& work = *work_;
      ++at_work_;
      lock.unlock();
      work();
      lock.lock();
      if (--at_work_ == 0) ended_.notify_all();
    }
  }

  int count_;
  std::mutex mutex_;
  std::condition_variable begun_, ended_;
  const std::function<void()>* work_ = nullptr;
  unsigned long number_ = 0;  ///< of the work
  int at_work_ = 0;           ///< helpers
  bool ending_ = false;
  std::vector<std::jthread> threads_;  ///< joined first
};

}  // namespace bromwich
