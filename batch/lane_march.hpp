#pragma once
// March of eight scenes in the lanes of a vector, on one grid, by the steps of core/host/scene_steps.hpp. y is
// continuous, with steps in parts where shared sources are rough (core/march/split.cpp), or has the stages of Radau
// IIA. The scenes share their dynamics and M, or each has its own.
//
// A lane is settled if the solution passes, with a margin, each check by which Certification would call it solved
// without another solve: residual, alternating y, growth of perturbations, rounding, impulses of contacts, oscillations
// that the steps do not resolve. Lanes that are not settled are left to a single solve.

#include "lane_plan.hpp"

#include <memory>
#include <vector>

namespace bromwich {

struct LaneState;  // batch/lane_run.hpp

struct LaneOutcome {
  bool settled = false;
  bool other_at_zero = false;  ///< the problem at t = 0 has another solution
  double residual = 0;
};

/// Steps up to eight scenes; keeps its buffers. One thread.
class LaneMarch {
 public:
  /// For scenes of the sizes of this plan.
  explicit LaneMarch(const LanePlan&);
  ~LaneMarch();
  /// All plans are of one kind; sources are own ones in all lanes or in none.
  void run(const std::vector<const LaneInput*>& inputs, std::vector<LaneOutcome>& outcomes);
  /// Rows of one lane at time points of the grid, in the units of the scene, after `run`; x: the given components.
  void write_y(Index lane, const std::vector<Index>& rows, Eigen::Ref<RowMatrix> y) const;
  void write_w(Index lane, const std::vector<Index>& rows, Eigen::Ref<RowMatrix> w) const;
  void write_x(Index lane, const std::vector<Index>& rows, const std::vector<Index>& components,
               Eigen::Ref<RowMatrix> x) const;

  static double bytes(Index m, Index n, Index J) { return 64.0 * double(J + 1) * double(3 * m + 5 * n + 2); }

 private:
  std::unique_ptr<LaneState> s_;
};

}  // namespace bromwich
