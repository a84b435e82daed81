#include "batch/side_by_side.hpp"

#include "core/base/error.hpp"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>
#include <utility>

namespace bromwich {

namespace {

constexpr std::chrono::milliseconds between_polls{50};

}  // namespace

SideBySide::SideBySide(const Batch& batch, const Options& options, BatchResult& result, MakeBackend another,
                       int threads)
    : batch_(batch),
      options_(options),
      interrupted_(options.interrupted),
      result_(result),
      another_(std::move(another)),
      workers_(std::size_t(std::max(1, threads))) {
  options_.interrupted = [this] { return stop_.load(); };
}

void SideBySide::take(const std::vector<Index>& scenes, bool shares, const std::function<void(Index)>& done,
                      const std::function<void()>& say) {
  const std::size_t count = std::min(workers_.size(), scenes.size());
  std::mutex mutex;
  std::condition_variable ended;
  std::size_t running = count;
  std::exception_ptr failure;
  next_ = 0;
  std::vector<std::jthread> threads;
  for (std::size_t i = 0; i < count; ++i)
    threads.emplace_back([&, i] {
      std::exception_ptr own;
      try {
        work(workers_[i], scenes, shares, done);
      } catch (...) {
        own = std::current_exception();
        stop_ = true;
      }
      const std::lock_guard lock(mutex);
      if (own && !failure) failure = own;
      --running;
      ended.notify_one();
    });
  const auto poll = [&] {
    try {
      say();
      if (interrupted_ && interrupted_()) stop_ = true;
    } catch (...) {  // of the caller's functions
      stop_ = true;
      const std::lock_guard lock(mutex);
      if (!failure) failure = std::current_exception();
    }
  };
  for (bool all = false, failed = false; !all;) {
    {
      std::unique_lock lock(mutex);
      all = ended.wait_for(lock, between_polls, [&] { return running == 0; });
      failed = failure != nullptr;
    }
    if (!failed) poll();
  }
  threads.clear();  // joins
  if (failure) std::rethrow_exception(failure);
}

void SideBySide::work(Worker& worker, const std::vector<Index>& scenes, bool shares,
                      const std::function<void(Index)>& done) {
  if (!worker.solves) {
    worker.backend = another_();
    worker.solves = std::make_unique<SingleSolves>(batch_, *worker.backend, options_, result_);
  }
  worker.solves->forget();
  for (std::size_t i = next_++; i < scenes.size() && !stop_; i = next_++) try {
      worker.solves->take(scenes[i], shares);
      done(scenes[i]);
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::does_not_fit) throw;
      worker.solves->forget();
    }
}

Index SideBySide::prepared() const {
  Index all = 0;
  for (const Worker& worker : workers_)
    if (worker.solves) all += worker.solves->prepared();
  return all;
}

}  // namespace bromwich
