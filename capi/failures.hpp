#pragma once
// No exception leaves the C interface: each becomes a code and one line of text.

#include "core/base/error.hpp"

#include <stdexcept>
#include <string>
#include <utility>

namespace bromwich::capi {

/// A function of the caller did not return 0.
struct Stopped : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The code of the exception that is being handled; bromwich_error has its text.
int code_of_exception() noexcept;

/// Runs `body`; BROMWICH_OK, or the code of what it throws.
template <class Body>
int guarded(Body&& body) noexcept {
  try {
    std::forward<Body>(body)();
    return 0;
  } catch (...) {
    return code_of_exception();
  }
}

/// The object of a pointer; throws Error for NULL.
template <class T>
T& given(T* pointer, const char* argument) {
  if (!pointer) throw Error(argument, "is NULL", "give a pointer");
  return *pointer;
}

/// The same of an array that has entries.
template <class T>
T* given_array(T* pointer, long long count, const char* argument) {
  if (count < 0) throw Error(argument, "has " + std::to_string(count) + " entries", "give 0 or more");
  if (count > 0 && !pointer) throw Error(argument, "is NULL", "give " + std::to_string(count) + " values");
  return pointer;
}

}  // namespace bromwich::capi
