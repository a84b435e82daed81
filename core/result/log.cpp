#include "core/result/log.hpp"

#include "core/base/text.hpp"

#include <cstdarg>

namespace bromwich {

void note(const Log& log, LogLevel level, const char* format, ...) {
  if (!log) return;
  std::va_list values;
  va_start(values, format);
  std::string line = text(format, values);
  va_end(values);
  log({level, std::move(line)});
}

}  // namespace bromwich
