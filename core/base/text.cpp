#include "core/base/text.hpp"

#include <cstdio>

namespace bromwich {

std::string text(const char* format, std::va_list values) {
  std::va_list again;
  va_copy(again, values);
  std::string result(std::size_t(std::vsnprintf(nullptr, 0, format, values)), '\0');
  std::vsnprintf(result.data(), result.size() + 1, format, again);
  va_end(again);
  return result;
}

std::string text(const char* format, ...) {
  std::va_list values;
  va_start(values, format);
  std::string result = text(format, values);
  va_end(values);
  return result;
}

}  // namespace bromwich
