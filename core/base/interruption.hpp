#pragma once
// Interruption by the user during long set-up loops. Between steps, the methods check it themselves.

#include <functional>
#include <string>

namespace bromwich {

/// Thrown by check_interruption; solve() turns it into a status.
struct Interrupted {};

/// During its lifetime check_interruption on this thread calls `interrupted`, unless that is empty, and why_interrupted
/// is `why`; null: as before. Both have to outlive the object.
class InterruptedBy {
 public:
  explicit InterruptedBy(const std::function<bool()>& interrupted, const std::string* why = nullptr);
  ~InterruptedBy();
  InterruptedBy(const InterruptedBy&) = delete;
  InterruptedBy& operator=(const InterruptedBy&) = delete;

 private:
  const std::function<bool()>* before_;
  const std::string* why_before_;
};

/// What ends a solve that is interrupted on this thread: "stopped on request", or a limit of time.
const std::string& why_interrupted();

/// Throws Interrupted if the user wants to stop.
void check_interruption();

/// Calls check_interruption at every 32nd call: values of sources may take long.
class Polling {
 public:
  void operator()() {
    if (++calls_ % 32 == 0) check_interruption();
  }

 private:
  unsigned calls_ = 0;
};

}  // namespace bromwich
