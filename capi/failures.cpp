#include "capi/failures.hpp"

#include "bromwich/bromwich.h"
#include "core/base/interruption.hpp"

#include <new>

namespace bromwich::capi {

namespace {

std::string& last_failure() {
  thread_local std::string text;
  return text;
}

int failed(int code, const std::string& text) {
  last_failure() = text;
  return code;
}

int code_of(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::bad_input:
      return BROMWICH_BAD_INPUT;
    case ErrorKind::does_not_fit:
      return BROMWICH_DOES_NOT_FIT;
    case ErrorKind::device:
      return BROMWICH_DEVICE;
    case ErrorKind::internal:
      break;
  }
  return BROMWICH_INTERNAL;
}

int code_and_text() {
  try {
    throw;
  } catch (const Error& error) {
    return failed(code_of(error.kind()), error.what());
  } catch (const Stopped& stopped) {
    return failed(BROMWICH_STOPPED, stopped.what());
  } catch (const Interrupted&) {
    return failed(BROMWICH_STOPPED, "interrupted: the caller asked for it");
  } catch (const std::bad_alloc&) {
    return failed(BROMWICH_DOES_NOT_FIT, "memory: there is not enough; use fewer steps or states");
  } catch (const std::exception& error) {
    return failed(BROMWICH_INTERNAL, std::string("internal error: ") + error.what() + "; please report it");
  } catch (...) {
    return failed(BROMWICH_INTERNAL, "internal error: an unknown exception; please report it");
  }
}

}  // namespace

int code_of_exception() noexcept {
  try {
    return code_and_text();
  } catch (...) {  // no memory for the text
    return BROMWICH_DOES_NOT_FIT;
  }
}

}  // namespace bromwich::capi

const char* bromwich_version(void) { return BROMWICH_VERSION; }

const char* bromwich_error(void) { return bromwich::capi::last_failure().c_str(); }
