#pragma once
// What a running solve asks of Python: progress, whether to stop, and whether Ctrl-C was pressed.

#include "core/base/interruption.hpp"
#include "core/result/options.hpp"

#include <nanobind/nanobind.h>

#include <chrono>
#include <exception>
#include <functional>
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

/// What `work` returns, called without the interpreter's lock. Ctrl-C meanwhile leaves as a KeyboardInterrupt.
template <class Work>
auto interruptible(const Work& work) {
  Calls calls{nb::none(), nb::none()};
  const std::function<bool()> asked = [&calls] { return calls.interrupted(); };
  try {
    const nb::gil_scoped_release released;
    const InterruptedBy keyboard(asked);
    return work();
  } catch (const Interrupted&) {
    PyErr_SetNone(PyExc_KeyboardInterrupt);
    throw nb::python_error();
  }
}

}  // namespace bromwich::python
