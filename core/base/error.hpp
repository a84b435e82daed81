#pragma once

#include <stdexcept>
#include <string>

namespace bromwich {

/// What a program can do about an Error.
enum class ErrorKind {
  bad_input,     ///< change the input
  does_not_fit,  ///< ask for less: memory or work exceeds a limit
  device,        ///< a device or a library failed; the input may be valid
  internal,      ///< a defect of this library
};

/// "bad input", "does not fit", ...
const char* to_string(ErrorKind);

/// One line that names the argument, what was found, and what to do.
class Error : public std::runtime_error {
 public:
  Error(const std::string& argument, const std::string& found, const std::string& remedy,
        ErrorKind kind = ErrorKind::bad_input)
      : std::runtime_error(argument + ": " + found + "; " + remedy), kind_(kind) {}

  ErrorKind kind() const { return kind_; }

 private:
  ErrorKind kind_;
};

/// zE - A is singular to rounding: z is an eigenvalue of the dynamics.
class SingularShift : public Error {
 public:
  using Error::Error;
};

inline const char* to_string(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::bad_input:
      return "bad input";
    case ErrorKind::does_not_fit:
      return "does not fit";
    case ErrorKind::device:
      return "device";
    case ErrorKind::internal:
      break;
  }
  return "internal";
}

}  // namespace bromwich
