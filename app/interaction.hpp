#pragma once
// What happens on the terminal while a solve runs: a progress line, and Ctrl-C.

#include "core/solve.hpp"

#include <chrono>

namespace bromwich::app {

/// One self-overwriting line on standard error, at most ten times a second; silent where that is no terminal.
class ProgressLine {
 public:
  ProgressLine();
  ~ProgressLine() { clear(); }
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  bool visible() const { return visible_; }
  void show(const Progress& progress);
  void clear();

 private:
  using Clock = std::chrono::steady_clock;
  bool visible_;
  bool drawn_ = false;
  Clock::time_point next_;
};

/// From now on the first SIGINT or SIGTERM only sets a flag, so that the valid part is written; a second one ends the
/// process as usual.
void catch_interrupts();
bool interrupted();

}  // namespace bromwich::app
