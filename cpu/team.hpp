#pragma once
// Loops shared by threads, also where other processes take the cores.
//
// OpenMP makes and places the threads (OMP_NUM_THREADS, OMP_PLACES). Its own loops end at a barrier for all threads of
// a team: one whose core another process has got arrives milliseconds later, after a loop of microseconds. Here the
// calling thread takes iterations as the others do. It waits for those that others have begun, never for a thread.

#include "core/base/types.hpp"

#include <algorithm>
#include <atomic>
#include <memory>
#include <thread>
#include <type_traits>

namespace bromwich::cpu {

class Team {
 public:
  /// Makes the threads, or as many as the system grants.
  explicit Team(int threads);
  ~Team();
  Team(const Team&) = delete;
  Team& operator=(const Team&) = delete;

  /// Number of threads, the calling thread included.
  int threads() const { return threads_; }

  /// Calls use(i, thread) once for each 0 <= i < count, in any order and concurrently; 0 <= thread < threads() differs
  /// among concurrent calls and selects scratch memory. Neighbouring iterations mostly have the same thread, from one
  /// loop to the next. Rethrows the first exception after all calls have ended. Inside a loop of the same team the
  /// thread that calls it does all alone, as thread 0.
  template <class Use>
  void share(Index count, Use&& use) {
    share(count, true, use);
  }
  /// The same, by the calling thread alone if the work is not `enough` for more.
  template <class Use>
  void share(Index count, bool enough, Use&& use) {
    if (!enough) {
      for (Index i = 0; i < count; ++i) use(i, 0);
      return;
    }
    run(count,
        {[](void* given, Index i, int thread) { (*static_cast<std::remove_reference_t<Use>*>(given))(i, thread); },
         const_cast<void*>(static_cast<const void*>(&use))});
  }

  /// Calls use(begin, end) for ranges that partition 0 <= i < count: several for each thread if the work is `enough`
  /// for more than one, otherwise one.
  template <class Use>
  void ranges(Index count, bool enough, Use&& use) {
    const Index parts = std::min<Index>(count, enough && threads_ > 1 ? ranges_per_thread * threads_ : 1);
    share(parts, [&](Index p, int) { use(p * count / parts, (p + 1) * count / parts); });
  }
  /// The same with use(i) for each i.
  template <class Use>
  void each(Index count, bool enough, Use&& use) {
    ranges(count, enough, [&](Index begin, Index end) {
      for (Index i = begin; i < end; ++i) use(i);
    });
  }

  /// Raises `value` to `other` if that is larger; neither is NaN.
  static void raise(std::atomic<double>& value, double other) {
    for (double old = value; old < other && !value.compare_exchange_weak(old, other);) {
    }
  }

 private:
  static constexpr Index ranges_per_thread =
      4;  ///< one that begins late leaves a quarter of its share or less to wait for

  struct Loop {
    void (*call)(void* use, Index i, int thread);
    void* use;
  };
  /// The iterations next <= i < end, taken one by one, first by one thread.
  struct alignas(64) Part {
    std::atomic<Index> next;
    Index end;
  };
  class Failure;

  void run(Index count, Loop);
  void alone(Index count, Loop) const;
  void work(int thread);
  void help(int thread);
  bool enter(unsigned& done);

  int threads_ = 1, made_in_;
  Loop loop_{};
  std::unique_ptr<Part[]> parts_;
  int number_of_parts_ = 0;
  Failure* failure_ = nullptr;
  alignas(64) std::atomic<unsigned> state_ = 0;   ///< number of the loop, threads inside, and whether others may enter
  alignas(64) std::atomic<unsigned> number_ = 0;  ///< of the loop; sleeping threads wait for the next one
  std::atomic<int> asleep_ = 0;                   ///< threads that have to be woken up
  std::atomic<bool> caller_sleeps_ = false, occupied_ = false, ending_ = false;
  std::unique_ptr<std::thread> first_;  ///< of the OpenMP team: it waits for the end
};

}  // namespace bromwich::cpu
