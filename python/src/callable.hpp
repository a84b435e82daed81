#pragma once
// A Python object that C++ keeps, copies and drops without holding the interpreter's lock.

#include <nanobind/nanobind.h>

#include <memory>
#include <utility>

namespace bromwich::python {

namespace nb = nanobind;

class Kept {
 public:
  Kept() = default;
  /// The caller holds the lock.
  explicit Kept(nb::object object) : object_(new nb::object(std::move(object)), drop) {}

  explicit operator bool() const { return bool(object_); }
  /// The caller holds the lock.
  const nb::object& get() const { return *object_; }

 private:
  static void drop(nb::object* object) {
    if (!nb::is_alive()) return;  // the interpreter has ended, and the object with it
    const nb::gil_scoped_acquire lock;
    delete object;
  }

  std::shared_ptr<nb::object> object_;
};

}  // namespace bromwich::python
