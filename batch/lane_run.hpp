#pragma once
// The state of a LaneMarch, and its run for matrices that all lanes share (C = double) or that each has (C = Lanes).

#include "../core/host/stage_steps.hpp"
#include "lane_plan.hpp"
#include "lane_problem.hpp"

#include <array>
#include <memory>
#include <vector>

namespace bromwich {

struct LaneState {
  using Lanes = simd::Lanes;
  using LaneMask = simd::LaneMask;

  explicit LaneState(const LanePlan&);
  void take(const std::vector<const LaneInput*>&);
  bool shared() const;  ///< the matrices
  const LanePlan& plan(Index lane) const { return *input(lane).plan; }
  const LaneInput& input(Index lane) const { return *inputs[std::size_t(lane < used ? lane : 0)]; }
  host::StageSteps& steps_of(Index lane);
  unsigned rigid() const;

  std::vector<const LaneInput*> inputs;
  Index m, n, J, used = 0;
  std::vector<Lanes> x, y;
  LaneMask lost = {}, other = {};
  Lanes residual = {};

  /// The sources of a step: LaneSources by these names.
  struct Sources {
    scene_steps::Source<Lanes> drift, g, at_points, growth_drift, f;
  };
  Sources sources();

 private:
  // Tables of the lanes side by side.
  struct Beside {
    std::vector<Lanes> drift, g, f, at_points, growth_drift;
  };
  struct BesideMaps {
    std::vector<Lanes> drift, q, growth, f, g;
  };
  // Those of one scene, made where one of its steps is taken singly.
  struct SingleSteps {
    const StageProblem* of = nullptr;
    StageProblem own;  ///< with maps
    std::unique_ptr<host::StageSteps> steps;
  };

  const LaneSources& tables(Index lane) const { return input(lane).tables(); }
  const SourceSamples* samples() const { return inputs[0]->samples; }
  bool have_own_tables() const;
  void start();
  void fill(RowMatrix LaneSources::*table, std::vector<Lanes>& to);
  void fill(RowMatrix SourceMaps::*map, std::vector<Lanes>& to);

  Beside beside_;
  BesideMaps maps_;
  std::array<SingleSteps, simd::lanes> single_;
};

/// march, then the checks. Defined for double and simd::Lanes in files of their own.
template <class C>
void run_lanes(LaneState&);

}  // namespace bromwich
