#pragma once

#include <memory>
#include <stdexcept>
#include <string>

namespace bromwich {

/// How an application can react to an Error.
enum class ErrorKind {
  bad_input,     ///< change the input
  does_not_fit,  ///< memory or work exceeds a limit: reduce the size
  device,        ///< a device or a library failed; the input may be correct
  internal,      ///< a defect of this library
};

/// "bad input", "does not fit", ...
const char* to_string(ErrorKind);

/// what() is one line: "ARGUMENT: FOUND; REMEDY", with the argument or member at fault, the value found and the remedy.
class Error : public std::runtime_error {
 public:
  Error(const std::string& argument, const std::string& found, const std::string& remedy,
        ErrorKind kind = ErrorKind::bad_input)
      : std::runtime_error(argument + ": " + found + "; " + remedy),
        parts_(std::make_shared<const Parts>(Parts{argument, found, remedy})),
        kind_(kind) {}

  ErrorKind kind() const { return kind_; }
  /// The three parts of what().
  const std::string& argument() const { return parts_->argument; }
  const std::string& found() const { return parts_->found; }
  const std::string& remedy() const { return parts_->remedy; }

 private:
  struct Parts {
    std::string argument, found, remedy;
  };
  std::shared_ptr<const Parts> parts_;  ///< shared: copying an exception must not throw
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
