#include "cpu/team.hpp"

#include <omp.h>
#include <unistd.h>

#include <chrono>
#include <exception>
#include <mutex>
#include <vector>

namespace bromwich::cpu {

namespace {

// state_: the number of the loop, the threads inside, and whether others may enter.
constexpr unsigned open = 1, one_inside = 2, all_inside = 0xfffe, next_number = 0x10000;

/// Seconds a thread looks for the next loop before it sleeps. To wake it up costs the caller 5 to 20 microseconds, so
/// that loops with pauses of this length lose a twentieth at most. A process that is waiting for the core loses it for
/// this time.
constexpr double looks = 400e-6;
/// Seconds the caller looks for the end of what others have begun: an iteration takes less.
constexpr double looks_for_end = 50e-6;

/// Whether `ready` becomes true in `seconds`.
template <class Ready>
bool soon(double seconds, Ready ready) {
  using Clock = std::chrono::steady_clock;
  const auto end = Clock::now() + std::chrono::duration<double>(seconds);
  while (!ready())
    if (Clock::now() >= end) return false;
  return true;
}

/// Number of threads, at most `wanted`, that can exist beside this one. OpenMP ends the process when it cannot create a
/// thread (`ulimit -v`, for example), so this function creates them first, all waiting on one mutex.
int possible_threads(int wanted) {
  std::mutex all_made;
  std::unique_lock hold(all_made);
  std::vector<std::thread> made;
  try {
    made.reserve(std::size_t(wanted));
    while (int(made.size()) < wanted) made.emplace_back([&all_made] { const std::lock_guard wait(all_made); });
  } catch (const std::exception&) {  // the system refused a thread, or no memory is left
  }
  const int possible = int(made.size());
  hold.unlock();
  for (std::thread& thread : made) thread.join();
  return possible;
}

}  // namespace

/// The first exception of a loop.
class Team::Failure {
 public:
  void keep() {
    const std::lock_guard lock(mutex_);
    if (!first_) first_ = std::current_exception();
  }
  void rethrow() const {
    if (first_) std::rethrow_exception(first_);
  }

 private:
  std::mutex mutex_;
  std::exception_ptr first_;
};

Team::Team(int threads) : made_in_(getpid()) {
  if (threads > 1) threads_ = std::max(1, possible_threads(threads));
  parts_ = std::make_unique<Part[]>(std::size_t(threads_));
  if (threads_ == 1) return;
  first_ = std::make_unique<std::thread>([this] {
#pragma omp parallel num_threads(threads_)
    {
      const int thread = omp_get_thread_num();
      thread == 0 ? ending_.wait(false) : help(thread);
    }
  });
}

Team::~Team() {
  if (!first_) return;
  if (getpid() != made_in_) {  // a forked process has none of the threads: nothing ends, nothing can be joined
    static_cast<void>(first_.release());
    return;
  }
  ending_ = true;
  ending_.notify_all();
  ++number_;
  number_.notify_all();
  first_->join();
}

void Team::run(Index count, Loop loop) {
  if (count <= 1 || threads_ == 1 || occupied_.exchange(true, std::memory_order_acquire)) return alone(count, loop);
  Failure failure;
  failure_ = &failure;
  loop_ = loop;
  number_of_parts_ = int(std::min<Index>(count, threads_));
  for (int p = 0; p < number_of_parts_; ++p) {
    parts_[std::size_t(p)].next.store(p * count / number_of_parts_, std::memory_order_relaxed);
    parts_[std::size_t(p)].end = (p + 1) * count / number_of_parts_;
  }
  state_.store((state_.load(std::memory_order_relaxed) & ~(next_number - 1)) + next_number + open);
  ++number_;
  if (asleep_ > 0) number_.notify_all();
  work(0);
  state_ -= open;
  unsigned state = 0;
  const auto ended = [&] { return ((state = state_) & all_inside) == 0; };
  if (!soon(looks_for_end, ended)) {
    caller_sleeps_ = true;
    while (!ended()) state_.wait(state);
    caller_sleeps_ = false;
  }
  occupied_.store(false, std::memory_order_release);
  failure.rethrow();
}

void Team::alone(Index count, Loop loop) const {
  for (Index i = 0; i < count; ++i) loop.call(loop.use, i, 0);
}

/// A thread begins with a part of its own, and then helps with those of others.
void Team::work(int thread) {
  for (int k = 0; k < number_of_parts_; ++k) {
    Part& part = parts_[std::size_t((thread + k) % number_of_parts_)];
    for (Index i; (i = part.next.fetch_add(1, std::memory_order_relaxed)) < part.end;) try {
        loop_.call(loop_.use, i, thread);
      } catch (...) {
        failure_->keep();
      }
  }
}

/// Enters a loop that is open and not `done`.
bool Team::enter(unsigned& done) {
  unsigned state = state_.load(std::memory_order_acquire);
  while (state & open && state / next_number != done)
    if (state_.compare_exchange_weak(state, state + one_inside)) {
      done = state / next_number;
      return true;
    }
  return false;
}

void Team::help(int thread) {
  for (unsigned done = 0; !ending_;) {
    const unsigned number = number_;
    if (enter(done) || soon(looks, [&] { return ending_ || enter(done); })) {
      if (ending_) return;
      work(thread);
      state_ -= one_inside;
      if (caller_sleeps_) state_.notify_one();
    } else {
      ++asleep_;
      number_.wait(number);
      --asleep_;
    }
  }
}

}  // namespace bromwich::cpu
