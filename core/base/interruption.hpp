#pragma once
// Long loops before the first step ask whether the user wants to stop, as the methods do between their steps.

#include <functional>

namespace bromwich {

/// Thrown by check_interruption; solve() makes a status of it.
struct Interrupted {};

/// While it lives, check_interruption on this thread asks `interrupted`, where that is not empty.
class InterruptedBy {
 public:
  explicit InterruptedBy(const std::function<bool()>& interrupted);
  ~InterruptedBy();
  InterruptedBy(const InterruptedBy&) = delete;
  InterruptedBy& operator=(const InterruptedBy&) = delete;

 private:
  const std::function<bool()>* before_;
};

/// Throws Interrupted where that is wanted.
void check_interruption();

}  // namespace bromwich
