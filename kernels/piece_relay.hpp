#pragma once
// A transfer in pieces through a ring of slots. Each piece is started, arrives in its slot, and is taken out in parts
// by any number of threads. A thread that finds nothing to take out polls for arrivals and starts pieces that have a
// free slot. One thread alone suffices.

#include <atomic>
#include <cstddef>
#include <exception>
#include <thread>
#include <utility>
#include <vector>

namespace bromwich {

/// start(piece): begins to fill slot piece % slots. arrived(piece): whether the piece is complete; called in order of
/// the pieces. Neither is called concurrently; an exception ends the relay, see `failure`. take_out(piece, part) may
/// run concurrently.
template <class Start, class Arrived, class TakeOut>
class PieceRelay {
 public:
  PieceRelay(std::size_t pieces, std::size_t parts, std::size_t slots, Start start, Arrived arrived, TakeOut take_out)
      : pieces_(pieces),
        parts_(parts),
        taken_out_(slots),
        start_(std::move(start)),
        arrived_(std::move(arrived)),
        take_out_(std::move(take_out)) {
    for (auto& parts_taken : taken_out_) parts_taken = parts;
  }

  /// Starts pieces that have a free slot and polls for arrivals, unless another thread is doing so.
  void advance() noexcept {
    if (busy_.test_and_set(std::memory_order_acquire)) return std::this_thread::yield();
    try {
      std::size_t there = there_.load(std::memory_order_relaxed);
      while (there < started_ && arrived_(there)) there_.store(++there, std::memory_order_release);
      for (; started_ < pieces_; ++started_) {
        std::atomic<std::size_t>& taken = taken_out_[started_ % taken_out_.size()];
        if (taken.load(std::memory_order_acquire) < parts_) break;
        taken.store(0, std::memory_order_relaxed);
        start_(started_);
      }
    } catch (...) {
      failure_ = std::current_exception();
      failed_.store(true, std::memory_order_release);
    }
    busy_.clear(std::memory_order_release);
  }

  /// Called by each thread. Returns when all parts are taken out or in progress, or after a failure.
  void work() noexcept {
    for (;;) {
      const std::size_t ticket = next_.fetch_add(1, std::memory_order_relaxed);
      const std::size_t piece = ticket / parts_, part = ticket % parts_;
      if (piece >= pieces_) return;
      while (there_.load(std::memory_order_acquire) <= piece) {
        if (failed_.load(std::memory_order_acquire)) return;
        advance();
      }
      take_out_(piece, part);
      taken_out_[piece % taken_out_.size()].fetch_add(1, std::memory_order_release);
    }
  }

  /// Call after all threads have returned: the exception of `start` or `arrived`, or null.
  std::exception_ptr failure() const { return failure_; }

 private:
  std::size_t pieces_, parts_;
  std::vector<std::atomic<std::size_t>> taken_out_;  ///< parts taken out of the last piece of each slot
  Start start_;
  Arrived arrived_;
  TakeOut take_out_;
  std::size_t started_ = 0;  ///< used by the thread that holds busy_
  std::atomic<std::size_t> there_{0}, next_{0};
  std::atomic_flag busy_;
  std::atomic<bool> failed_{false};
  std::exception_ptr failure_;
};

}  // namespace bromwich
