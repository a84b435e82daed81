#pragma once
// Bad input: the one-line message that says what is wrong.

#include "core/base/error.hpp"

#include <functional>
#include <string>

namespace bromwich {

/// An input, and the beginning of its error message.
struct Refused {
  std::string text, message;
};

inline std::string refusal(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "nothing was refused";
}

}  // namespace bromwich
