#pragma once
// Ranks that are threads of one process, for tests of what several ranks compute.

#include "core/seam/communicator.hpp"

#include <barrier>
#include <exception>
#include <functional>
#include <thread>
#include <vector>

namespace bromwich {

struct ThreadBoard {
  explicit ThreadBoard(int size) : barrier(size), values(std::size_t(size)) {}
  std::barrier<> barrier;
  std::vector<Vector> values;
};

class ThreadRank final : public Communicator {
 public:
  ThreadRank(ThreadBoard& board, int rank) : Communicator(rank, int(board.values.size())), board_(board) {}

 private:
  // Every rank shows its values, and reads those of others before any of them shows the next ones.
  template <class Read>
  void exchange(const Vector& shown, Read read) {
    board_.values[std::size_t(rank())] = shown;
    board_.barrier.arrive_and_wait();
    read(board_.values);
    board_.barrier.arrive_and_wait();
  }
  void do_shift(const Vector& right, Vector& left) override {
    exchange(right, [&](const auto& all) {
      if (rank() > 0) left = all[std::size_t(rank() - 1)];
    });
  }
  void do_gather(const Vector& values, RowMatrix& to) override {
    exchange(values, [&](const auto& all) {
      for (int r = 0; r < size(); ++r) to.row(r) = all[std::size_t(r)].transpose();
    });
  }
  void do_maximum(Vector& values) override {
    const Vector own = values;
    exchange(own, [&](const auto& all) {
      for (const Vector& one : all) values = values.cwiseMax(one);
    });
  }
  void do_broadcast(double* values, Index count, int root) override {
    exchange(Eigen::Map<const Vector>(values, count),
             [&](const auto& all) { Eigen::Map<Vector>(values, count) = all[std::size_t(root)]; });
  }

  ThreadBoard& board_;
};

/// Runs `body` on `size` ranks; the exception of the first rank that threw one is thrown again. All ranks have to throw
/// where one does.
inline std::vector<Traffic> on_threads(int size, const std::function<void(Communicator&)>& body) {
  ThreadBoard board(size);
  std::vector<Traffic> sent(static_cast<std::size_t>(size));
  std::vector<std::exception_ptr> failures(static_cast<std::size_t>(size));
  {
    std::vector<std::jthread> threads;
    for (int r = 0; r < size; ++r)
      threads.emplace_back([&, r] {
        ThreadRank rank(board, r);
        try {
          body(rank);
        } catch (...) {
          failures[std::size_t(r)] = std::current_exception();
        }
        sent[std::size_t(r)] = rank.sent();
      });
  }
  for (const auto& failure : failures)
    if (failure) std::rethrow_exception(failure);
  return sent;
}

}  // namespace bromwich
