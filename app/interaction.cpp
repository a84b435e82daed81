#include "app/interaction.hpp"

#include <fmt/format.h>

#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>

namespace bromwich::app {

namespace {

std::atomic<bool> interrupt_flag{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler may only touch lock-free atomics");

void set_interrupt_flag(int) { interrupt_flag.store(true, std::memory_order_relaxed); }

}  // namespace

ProgressLine::ProgressLine() : visible_(::isatty(STDERR_FILENO) != 0), next_(Clock::now()) {}

void ProgressLine::show(const Progress& progress) {
  const auto now = Clock::now();
  if (!visible_ || now < next_) return;
  next_ = now + std::chrono::milliseconds(100);
  if (progress.total > 0)
    fmt::print(stderr, "\r\033[Kstep {} of {}", progress.iteration, progress.total);
  else
    fmt::print(stderr, "\r\033[Kiteration {}, change {:.2e}", progress.iteration, progress.change);
  std::fflush(stderr);
  drawn_ = true;
}

void ProgressLine::clear() {
  if (!drawn_) return;
  fmt::print(stderr, "\r\033[K");
  std::fflush(stderr);
  drawn_ = false;
}

void catch_interrupts() {
  struct sigaction action {};
  action.sa_handler = set_interrupt_flag;
  sigemptyset(&action.sa_mask);
  action.sa_flags = static_cast<int>(SA_RESETHAND) | SA_RESTART;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

bool interrupted() { return interrupt_flag.load(std::memory_order_relaxed); }

}  // namespace bromwich::app
