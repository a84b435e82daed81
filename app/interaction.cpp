#include "app/interaction.hpp"

#include "app/commands.hpp"
#include "app/ranks.hpp"
#include "app/text.hpp"

#include <fmt/format.h>

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>
#include <new>

namespace bromwich::app {

namespace {

std::atomic<bool> interrupt_flag{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler may only touch lock-free atomics");

/// Written before `doomed_set`, and only while that is false.
std::array<char, 4096> doomed{};
std::atomic<bool> doomed_set{false};

void handle(int signal) {
  if (!interrupt_flag.exchange(true, std::memory_order_relaxed)) return;
  if (doomed_set.load(std::memory_order_acquire)) ::unlink(doomed.data());
  ::signal(signal, SIG_DFL);
  ::raise(signal);
}

constexpr const char* out_of_memory =
    "memory: the problem does not fit into this machine's memory; use fewer --steps, --states or --threads, or a "
    "smaller scene";

/// Exceptions that leave a parallel region end here. The heap may be exhausted: nothing is allocated.
[[noreturn]] void last_words() {
  const char* line = "internal error: an exception was not caught; please report it with the command line";
  try {
    if (std::current_exception()) throw;
  } catch (const std::bad_alloc&) {
    line = out_of_memory;
  } catch (...) {
  }
  for (const char* part : {"bromwich: ", line, "\n"})
    if (::write(STDERR_FILENO, part, std::strlen(part)) < 0) break;
  if (doomed_set.load(std::memory_order_acquire)) ::unlink(doomed.data());
  ::_exit(exit_bad_input);
}

/// A closed output is replaced by one that cannot be written: open for reading.
void occupy(int descriptor) {
  if (::fcntl(descriptor, F_GETFD) != -1 || errno != EBADF) return;
  const int found = ::open("/dev/null", descriptor == STDERR_FILENO ? O_WRONLY : O_RDONLY);
  if (found >= 0 && found != descriptor) {
    ::dup2(found, descriptor);
    ::close(found);
  }
}

constexpr std::chrono::seconds quiet_time{1};  ///< no line for what is over by then
constexpr std::chrono::milliseconds redrawn_every{100};
constexpr std::size_t longest_line = 78;  ///< a longer line would wrap, and stay

/// "7 s", "3 min 20 s", "5 h 10 min": an estimate has no more digits.
std::string rounded_seconds(double seconds) {
  const auto whole = static_cast<long long>(std::ceil(seconds));
  if (whole < 100) return fmt::format("{} s", whole);
  if (whole < 6000) return fmt::format("{} min {} s", whole / 60, whole % 60);
  return fmt::format("{} h {} min", whole / 3600, whole / 60 % 60);
}

/// A closed terminal is no reason to stop: failures are ignored.
void draw(const std::string& text) {
  std::fputs(("\r\033[K" + text).c_str(), stderr);
  std::fflush(stderr);
}

}  // namespace

ProgressLine::ProgressLine(double tolerance)
    : visible_(first_rank() && ::isatty(STDERR_FILENO) != 0),
      start_(Clock::now()),
      left_(tolerance),
      reported_(start_) {
  if (!visible_) return;
  const SignalsWait blocked;  // they are for the thread that solves
  drawing_ = std::jthread([this](const std::stop_token& stop) { keep_drawing(stop); });
}

void ProgressLine::keep_drawing(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (!wake_.wait_until(lock, stop, std::max(Clock::now() + redrawn_every, start_ + quiet_time), [] {
    return false;
  }) && !stop.stop_requested()) {
    draw(words(Clock::now()).substr(0, longest_line));
    drawn_ = true;
  }
}

std::string ProgressLine::words(Clock::time_point now) const {
  const double spent = std::chrono::duration<double>(now - start_).count();
  if (!last_) return fmt::format("set-up, {} spent", rounded_seconds(spent));
  const std::string done = last_->total > 0 ? fmt::format("step {} of {}", last_->iteration, last_->total)
                                            : fmt::format("sweep {}, change {:.1e}", last_->iteration, last_->change);
  if (now - reported_ > quiet_time)  // nothing can be counted
    return fmt::format("after {}, {} spent", done, rounded_seconds(spent));
  return until_ ? fmt::format("{}, about {} left", done, rounded_seconds(std::max(0., *until_ - spent))) : done;
}

void ProgressLine::show(const Progress& progress) {
  if (!visible_) return;
  const std::lock_guard lock(mutex_);
  reported_ = Clock::now();
  const double seconds = std::chrono::duration<double>(reported_ - start_).count();
  const std::optional<double> left = left_.after(progress, seconds);
  until_ = left ? std::optional(seconds + *left) : std::nullopt;
  last_ = progress;
}

void ProgressLine::clear() {
  const std::lock_guard lock(mutex_);
  if (!drawn_) return;
  draw("");
  drawn_ = false;
}

void ProgressLine::finish() {
  drawing_.request_stop();
  if (drawing_.joinable()) drawing_.join();
  clear();
}

void catch_interrupts() {
  struct sigaction action {};
  action.sa_handler = handle;
  sigemptyset(&action.sa_mask);
  action.sa_flags = SA_RESTART | static_cast<int>(SA_NODEFER);  // the second signal ends the process from the handler
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

bool interrupted() { return interrupt_flag.load(std::memory_order_relaxed); }

void remove_when_killed(const std::string& path) {
  doomed_set.store(false, std::memory_order_release);
  if (path.empty() || path.size() >= doomed.size()) return;
  std::copy(path.begin(), path.end(), doomed.begin());
  doomed[path.size()] = '\0';
  doomed_set.store(true, std::memory_order_release);
}

SignalsWait::SignalsWait() {
  sigset_t waiting;
  sigemptyset(&waiting);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&waiting, signal);
  pthread_sigmask(SIG_BLOCK, &waiting, &before_);
}

SignalsWait::~SignalsWait() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }

void prepare_process() {
  for (const int descriptor : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) occupy(descriptor);
  ::signal(SIGXFSZ, SIG_IGN);
  std::set_terminate(last_words);
}

void complain(const std::string& message) {
  if (!first_rank()) {
    held_complaint() = one_line(message);
    return;
  }
  const std::string line = "bromwich: " + one_line(message) + "\n";
  std::fwrite(line.data(), 1, line.size(), stderr);
  std::fflush(stderr);
}

}  // namespace bromwich::app
