#include "core/base/interruption.hpp"

namespace bromwich {

namespace {

const std::string on_request = "stopped on request";

thread_local const std::function<bool()>* asked = nullptr;
thread_local const std::string* reason = &on_request;

}  // namespace

InterruptedBy::InterruptedBy(const std::function<bool()>& interrupted, const std::string* why)
    : before_(asked), why_before_(reason) {
  asked = &interrupted;
  if (why) reason = why;
}

InterruptedBy::~InterruptedBy() {
  asked = before_;
  reason = why_before_;
}

const std::string& why_interrupted() { return *reason; }

void check_interruption() {
  if (asked && *asked && (*asked)()) throw Interrupted{};
}

}  // namespace bromwich
