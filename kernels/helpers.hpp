#pragma once
// Sleeping threads that share work of less than a millisecond. A thread that wakes up late is not waited for, unlike in
// an OpenMP team, where the slowest thread decides.

#include <condition_variable>
#include <functional>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace bromwich {

class Helpers {
 public:
  /// Threads are created by the first `share`.
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

  /// The calling thread runs `first`, then `work`; the others run `work` as soon as they wake up. `work` returns when
  /// nothing is left to begin; threads that wake up later skip it. Returns after all calls have returned. Neither
  /// function may throw.
  void share(const std::function<void()>& work, const std::function<void()>& first) {
    {
      const std::lock_guard lock(mutex_);
      try {
        while (int(threads_.size()) < count_) threads_.emplace_back([this] { help(); });
      } catch (const std::system_error&) {
        count_ = int(threads_.size());  // no more threads are available
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
  unsigned long number_ = 0;  ///< of the current work
  int at_work_ = 0;           ///< helpers that run `work`
  bool ending_ = false;
  std::vector<std::jthread> threads_;  ///< joined before the members above are destroyed
};

}  // namespace bromwich
