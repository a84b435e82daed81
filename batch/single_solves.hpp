#pragma once
// Scenes of a batch that are solved one by one, each with all the checks of a single solve, but for those with rigid
// contacts whose problems have one solution: like those of lanes they are not compared with a located solution, which
// takes several times as long as their steps. A thread has one of these, with a backend of its own
// (batch/side_by_side.hpp).

#include "../core/scene/natural_units.hpp"
#include "../core/solve/solver.hpp"
#include "batch.hpp"

#include <memory>
#include <vector>

namespace bromwich {

class SingleSolves {
 public:
  /// The rows of each scene in `result` are written by one thread at a time.
  SingleSolves(const Batch&, Backend&, const Options&, BatchResult& result);

  /// Writes status and rows of scene k; bad values of the scene end it as unsupported. `shares`: its dynamics and M are
  /// those of the scenes before it since `forget`. Throws Error for options and machines.
  void take(Index k, bool shares);
  /// Discards the data that the scenes of one group share.
  void forget() { solvers_.clear(); }
  Index prepared() const { return prepared_; }  ///< solves by a Solver that other scenes have used

 private:
  // The Solver of the units that a single solve would choose: those of its first scene stay.
  struct UnitSolver {
    NaturalUnits units;
    std::unique_ptr<Solver> solver;
  };
  static constexpr std::size_t most_solvers = 4;

  Options options_of(const Scene&) const;
  Result solved_by_solver(const Scene&);
  Result with_rows(const Scene&, Result) const;
  void write(Index k, const Scene&, const Result&);

  const Batch& batch_;
  Backend& backend_;
  const Options& options_;
  BatchResult& result_;
  bool own_sources_;
  std::vector<UnitSolver> solvers_;
  Index prepared_ = 0;
};

/// Writes NaN into the rows of scene k.
void clear_rows(BatchResult&, Index k);

}  // namespace bromwich
