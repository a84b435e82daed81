#pragma once
// The parts of a run from its start to its end: where they may end, and what solves them.

#include "app/times_of_run.hpp"
#include "core/solve/solver.hpp"

#include <memory>
#include <vector>

namespace bromwich::app {

/// Where parts may end: not at a jump of f or g, whose value there would be one of two.
class Boundaries {
 public:
  Boundaries(const Scene& scene, Index steps) : scene_(scene), steps_(steps), h_(scene.T / double(steps)) {}

  double time(Index j) const { return double(j) * scene_.T / double(steps_); }
  /// The first time point from `wanted` on that is no jump.
  Index from(Index wanted) const;

 private:
  bool jumps(Index j) const;

  const Scene& scene_;
  Index steps_;
  double h_;
};

/// The solver of parts of one length.
class PartSolver {
 public:
  PartSolver(const Scene& scene, Backend& backend, const Options& options)
      : scene_(scene), backend_(backend), options_(options) {}

  Result solve(const TimesOfRun& times, const Vector& x);
  /// The same part, and those after it, with all states.
  void record_all();
  Result solve_again();

  const Scene& part() const { return part_; }
  /// States of a part that are recorded.
  Index recorded() const { return Index(recorded_components(scene_, options_).size()); }

 private:
  std::vector<double> within(std::vector<double> times) const;

  const Scene& scene_;
  Backend& backend_;
  Options options_;
  Scene part_;
  std::unique_ptr<Solver> solver_;
  Index steps_ = 0;
  double length_ = 0;
};

}  // namespace bromwich::app
