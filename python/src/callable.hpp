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
  /// The caller holds the lock. Throws where the object was let go.
  const nb::object& get() const {
    if (!*object_) throw nb::value_error("bromwich: a function was collected before the scene that calls it");
    return *object_;
  }

  /// For the collector of cycles: the object, or null; and letting go of it.
  PyObject* held() const { return object_ ? object_->ptr() : nullptr; }
  void let_go() {
    if (object_) object_->reset();
  }

 private:
  static void drop(nb::object* object) {
    if (!nb::is_alive()) return;  // the interpreter has ended, and the object with it
    const nb::gil_scoped_acquire lock;
    delete object;
  }

  std::shared_ptr<nb::object> object_;
};

}  // namespace bromwich::python
