#pragma once
// Many small dense scenes stepped side by side by a backend, a thread for each (core/host/scene_steps.hpp). The
// operation is optional (FusedOperations::scene_march). Without it, scenes are stepped in the lanes of vectors on the
// threads of the host (batch/lane_march.hpp), with the same results.

#include "../base/plan.hpp"
#include "../base/types.hpp"
#include "../host/plan_layout.hpp"
#include "array.hpp"

#include <vector>

namespace bromwich {

/// The problems of one matrix, of u x u, on all of its 2^u active sets.
struct StoredSets {
  RowMatrix V;  ///< 2^u u x u: (y_S, w_I) = V(S) q in scaled units; the first entry is NaN where S is not usable
  Vector rows, columns;  ///< u: the scaling
  bool all_solutions =
      true;  ///< solutions are the only ones; otherwise they have to be certain (LaneProblem::try_stages)
};

/// Scenes of equal sizes on one grid, with smooth sources that they share. See core/host/scene_steps.hpp for the
/// letters. Either all share a plan, or each has its own, of one kind.
struct SceneMarchProblem {
  scene_steps::PlanLayout layout;
  Index J = 0;
  double h = 0, most_growth = 50;
  bool surely_P = false;
  bool certain = true;  ///< solutions are the only ones; otherwise they have to be (LaneProblem::try_stages)
  bool judged = false;  ///< active sets are those of least elements
  unsigned rigid = 0;
  Vector plan;  ///< one row; empty: each scene has its own
  /// (J+1) rows each. f contributes by tables in the units of the plan, or by maps of samples in those of the scenes.
  RowMatrix g, at_points, drift, growth_drift, f;
  RowMatrix driven;         ///< 2k: samples for drift_map and q_map; `f` has those for growth_map then
  RowMatrix seen, euler;    ///< n x m and 2^n n x n, of implicit Euler; empty: other solutions are not searched
  Vector part;              ///< m
  std::vector<Index> rows;  ///< time points whose rows are returned, increasing
};

struct SceneMarchOutcome {
  std::vector<char> settled;
  Vector residual;        ///< in the units of the scenes
  std::vector<int> runs;  ///< K x 2^n: for how many rows each active set has lasted, of the scenes that are settled
};

class SceneMarch : public Plan {
 public:
  /// x0 and y_0 of the scenes, one row each, and their plans where each has its own. `known`: scenes whose other
  /// solutions are not searched. Work of a device may go on after the return.
  virtual void start(const RowMatrix& x0, const RowMatrix& y0, const std::vector<char>& known,
                     const RowMatrix& plans) = 0;
  /// Of the last start. Waits for the checks, which run while x and y are fetched.
  virtual SceneMarchOutcome outcome() = 0;
  /// The rows of all scenes, one scene after the other, in their own units: m and n columns.
  virtual const Array& x() = 0;
  virtual const Array& y() = 0;
};

}  // namespace bromwich
