#include "calls.hpp"

#include <utility>

namespace bromwich::python {
namespace {

/// Taking the interpreter's lock may mean to wait for another thread of Python: not in every step.
constexpr std::chrono::milliseconds pause{20};

bool due(std::chrono::steady_clock::time_point& next) {
  const auto now = std::chrono::steady_clock::now();
  if (now < next) return false;
  next = now + pause;
  return true;
}

}  // namespace

template <class Work>
void Calls::call(const Work& work) {
  const nb::gil_scoped_acquire lock;
  try {
    work();
  } catch (const nb::python_error& error) {
    if (error.matches(PyExc_KeyboardInterrupt))
      by_keyboard_ = true;
    else
      failure_ = std::current_exception();
    stopped_ = true;
  }
}

void Calls::progress(const Progress& p) {
  if (progress_.is_none() || stopped_ || !due(next_progress_)) return;
  call([&] { progress_(p.iteration, p.total, p.change); });
}

bool Calls::interrupted() {
  if (stopped_ || !due(next_poll_)) return stopped_;
  call([&] {
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    if (!stop_.is_none() && nb::cast<bool>(nb::bool_(stop_()))) stopped_ = true;
  });
  return stopped_;
}

void Calls::raise() const {
  if (failure_) std::rethrow_exception(failure_);
}

}  // namespace bromwich::python
