#pragma once
// Scenes solved by several threads at once, each thread with a backend of its own. One scene of moderate size leaves
// most of a device idle, and its short loops divide badly among the threads of a processor.

#include "batch.hpp"
#include "single_solves.hpp"

#include <atomic>
#include <functional>
#include <memory>
#include <vector>

namespace bromwich {

class SideBySide {
 public:
  /// Up to `threads` threads; `another` makes their backends when they are needed first.
  SideBySide(const Batch&, const Options&, BatchResult&, MakeBackend another, int threads);

  /// Solves `scenes`, and calls done(k) after each for which take(k, shares) has returned, from threads of its own.
  /// The calling thread solves nothing: it polls options.interrupted and calls `say` a few times a second, and nobody
  /// else calls these two. Scenes that do not fit beside others are left. Rethrows the first other exception.
  void take(const std::vector<Index>& scenes, bool shares, const std::function<void(Index)>& done,
            const std::function<void()>& say);
  Index prepared() const;

 private:
  struct Worker {
    std::shared_ptr<Backend> backend;
    std::unique_ptr<SingleSolves> solves;
  };

  void work(Worker&, const std::vector<Index>& scenes, bool shares, const std::function<void(Index)>& done);

  const Batch& batch_;
  Options options_;  ///< of the workers: interrupted by `stop_`
  const std::function<bool()> interrupted_;
  BatchResult& result_;
  const MakeBackend another_;
  std::vector<Worker> workers_;
  std::atomic<bool> stop_ = false;
  std::atomic<std::size_t> next_ = 0;
};

}  // namespace bromwich
