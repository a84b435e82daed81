#pragma once
// What happens on the terminal while a solve runs: a progress line, and Ctrl-C.

#include "core/solve/solve.hpp"

#include <signal.h>

#include <chrono>
#include <string>

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

/// From now on the first SIGINT or SIGTERM only sets a flag, so that the valid part is written; a second one removes
/// the temporary file that is being written, if there is one, and ends the process as usual.
void catch_interrupts();
bool interrupted();

/// The file that a signal which ends the process removes first; "" = none. At most one at a time.
void remove_when_killed(const std::string& path);

/// SIGINT, SIGTERM and SIGHUP wait while this lives: between steps that belong together.
class SignalsWait {
 public:
  SignalsWait();
  ~SignalsWait();
  SignalsWait(const SignalsWait&) = delete;
  SignalsWait& operator=(const SignalsWait&) = delete;

 private:
  sigset_t before_;
};

/// Before anything else is done: descriptors 0 to 2 are open, so that no file of the user takes their place, a file
/// that grows beyond `ulimit -f` is an error of writing and not the end of the process, and an exception that nothing
/// can catch (memory that runs out in a thread) ends in one line.
void prepare_process();

/// "bromwich: MESSAGE" on standard error, in one line; nothing where that cannot be written.
void complain(const std::string& message);

}  // namespace bromwich::app
