#pragma once

#include <stdexcept>
#include <string>

namespace bromwich {

/// Bad input or a failing library: one line that names the argument, what was found, and what to do.
class Error : public std::runtime_error {
 public:
  Error(const std::string& argument, const std::string& found, const std::string& remedy)
      : std::runtime_error(argument + ": " + found + "; " + remedy) {}
};

}  // namespace bromwich
