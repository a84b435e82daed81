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
  void start();
  void fill_sources();
  bool shared() const;  ///< the matrices
  const LanePlan& plan(Index lane) const { return *input(lane).plan; }
  const LaneInput& input(Index lane) const { return *inputs[std::size_t(lane < used ? lane : 0)]; }
  const LaneSources& sources(Index lane) const {
    return input(lane).sources ? *input(lane).sources : plan(lane).sources;
  }
  double g_at(Index lane, Index j, Index i) const;
  host::StageSteps* steps_of(Index lane);
  unsigned rigid() const;

  std::vector<const LaneInput*> inputs;
  Index m, n, J, used = 0;
  std::vector<Lanes> x, y;
  struct OwnSources {
    std::vector<Lanes> drift, g, f, at_points, growth_drift;
  } own;
  bool own_sources = false;  ///< otherwise all lanes have those of the first
  LaneMask lost = {}, other = {};
  Lanes residual = {};
  std::array<std::unique_ptr<host::StageSteps>, simd::lanes> steps;  ///< of the lanes, made where a step needs one
  std::array<const StageProblem*, simd::lanes> steps_for = {};
};

/// march, then the checks. Defined for double and simd::Lanes in files of their own.
template <class C>
void run_lanes(LaneState&);

}  // namespace bromwich
