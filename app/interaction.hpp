#pragma once
// Interaction with the terminal during a solve: a progress line, and Ctrl-C.

#include "core/result/time_left.hpp"
#include "core/solve/solve.hpp"

#include <signal.h>

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

namespace bromwich::app {

/// One self-overwriting line on standard error, from the first second on: what is done, and an estimate of the time
/// left; the time spent where nothing is reported, as during set-up. Silent if that is not a terminal.
class ProgressLine {
 public:
  /// `tolerance`: the change of y at which iterations end.
  explicit ProgressLine(double tolerance = 1e-12);
  ~ProgressLine() { finish(); }
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  bool visible() const { return visible_; }
  void show(const Progress& progress);
  /// Takes the line away, for other output; it comes back.
  void clear();
  /// Takes the line away for good.
  void finish();

 private:
  using Clock = std::chrono::steady_clock;
  void keep_drawing(const std::stop_token&);
  std::string words(Clock::time_point now) const;

  const bool visible_;
  const Clock::time_point start_;
  std::mutex mutex_;  ///< of what follows
  std::condition_variable_any wake_;
  TimeLeft left_;
  std::optional<Progress> last_;  ///< report
  std::optional<double> until_;   ///< estimated end, in seconds from start_
  Clock::time_point reported_;
  bool drawn_ = false;
  std::jthread drawing_;  ///< the last member: it ends first
};

/// From now on the first SIGINT or SIGTERM only sets a flag, so that the valid part of the result is written. A second
/// one removes the current temporary file, if there is one, and ends the process as usual.
void catch_interrupts();
bool interrupted();

/// The file that is removed before a signal ends the process; "" = none. At most one at a time.
void remove_when_killed(const std::string& path);

/// Delays SIGINT, SIGTERM and SIGHUP during its lifetime, around operations that must not be separated.
class SignalsWait {
 public:
  SignalsWait();
  ~SignalsWait();
  SignalsWait(const SignalsWait&) = delete;
  SignalsWait& operator=(const SignalsWait&) = delete;

 private:
  sigset_t before_;
};

/// To be called first. Opens descriptors 0 to 2 if they are closed, so that no user file gets their numbers. Makes a
/// file beyond `ulimit -f` a write error instead of the end of the process. Lets an exception that cannot be caught
/// (out of memory in a thread) end the process with one line.
void prepare_process();

/// "bromwich: MESSAGE" on standard error, in one line; nothing if that cannot be written.
void complain(const std::string& message);

}  // namespace bromwich::app
