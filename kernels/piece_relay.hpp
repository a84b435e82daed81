#pragma once
// Pieces of a transfer on their way through a ring of slots. Each is started, arrives in its slot, and is taken out of
// it in parts by as many threads as there are; whoever finds nothing to take out looks for what has arrived and starts
// what has a slot. One thread alone gets through as well.

#include <atomic>
#include <cstddef>
#include <exception>
#include <thread>
#include <utility>
#include <vector>

namespace bromwich {

/// start(piece): begins to fill slot piece % slots. arrived(piece): whether that has ended; asked for the pieces in
/// order. Neither by two threads at a time; what they throw ends the relay, see `failure`. take_out(piece, part).
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

  /// Starts what has a slot and looks for what has arrived, unless another thread is about it.
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

  /// By each thread, until all parts are taken out or in work, or something has failed.
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

  /// After all threads: what `start` or `arrived` has thrown, or null.
  std::exception_ptr failure() const { return failure_; }

 private:
  std::size_t pieces_, parts_;
  std::vector<std::atomic<std::size_t>> taken_out_;  ///< parts, of the piece that each slot holds or held last
  Start start_;
  Arrived arrived_;
  TakeOut take_out_;
  std::size_t started_ = 0;  ///< of the thread that is busy
  std::atomic<std::size_t> there_{0}, next_{0};
  std::atomic_flag busy_;
  std::atomic<bool> failed_{false};
  std::exception_ptr failure_;
};

}  // namespace bromwich
