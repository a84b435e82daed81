#pragma once
// Interruption by the user during long set-up loops. Between steps, the methods check it themselves.

#include <functional>

namespace bromwich {

/// Thrown by check_interruption; solve() turns it into a status.
struct Interrupted {};

/// During its lifetime check_interruption on this thread calls `interrupted`, unless that is empty.
class InterruptedBy {
 public:
  explicit InterruptedBy(const std::function<bool()>& interrupted);
  ~InterruptedBy();
  InterruptedBy(const InterruptedBy&) = delete;
  InterruptedBy& operator=(const InterruptedBy&) = delete;

 private:
  const std::function<bool()>* before_;
};

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
