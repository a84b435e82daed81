#include "core/base/interruption.hpp"

namespace bromwich {

namespace {

thread_local const std::function<bool()>* asked = nullptr;

}  // namespace

InterruptedBy::InterruptedBy(const std::function<bool()>& interrupted) : before_(asked) { asked = &interrupted; }

InterruptedBy::~InterruptedBy() { asked = before_; }

void check_interruption() {
  if (asked && *asked && (*asked)()) throw Interrupted{};
}

}  // namespace bromwich
