#pragma once
// What a running solve asks of Python: progress, whether to stop, and whether Ctrl-C was pressed.

#include "core/result/options.hpp"

#include <nanobind/nanobind.h>

#include <chrono>
#include <exception>
#include <utility>

namespace bromwich::python {

namespace nb = nanobind;

/// Lives while a solve runs. The library calls it from the thread that called `solve`, without the interpreter's lock.
class Calls {
 public:
  Calls(nb::object progress, nb::object stop) : progress_(std::move(progress)), stop_(std::move(stop)) {}

  void progress(const Progress&);
  bool interrupted();

  /// With the lock held, after the solve: throws what a callback has raised.
  void raise() const;
  bool by_keyboard() const { return by_keyboard_; }

 private:
  using Clock = std::chrono::steady_clock;
  template <class Work>
  void call(const Work& work);

  nb::object progress_, stop_;
  std::exception_ptr failure_;
  bool by_keyboard_ = false, stopped_ = false;
  Clock::time_point next_poll_{}, next_progress_{};
};

/// What `work` returns, called without the interpreter's lock; then it throws what callbacks have raised.
template <class Work>
auto unlocked(Calls& calls, const Work& work) {
  auto answer = [&] {
    try {
      const nb::gil_scoped_release released;
      return work();
    } catch (...) {
      calls.raise();  // what came first
      throw;
    }
  }();
  calls.raise();
  answer->by_keyboard = calls.by_keyboard();
  return answer;
}

}  // namespace bromwich::python
