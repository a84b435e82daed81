#pragma once
// Many small dense scenes stepped side by side by a backend, a thread for each (core/host/scene_steps.hpp). The
// operation is optional (FusedOperations::scene_march). Without it, scenes are stepped in the lanes of vectors on the
// threads of the host (batch/lane_march.hpp), with the same results.

#include "../base/plan.hpp"
#include "../base/types.hpp"
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

/// Scenes that share their dynamics, M and sources. See core/host/scene_steps.hpp for the letters.
struct SceneMarchProblem {
  Index m = 0, n = 0, J = 0;
  double h = 0, most_growth = 50;
  bool stages = false, surely_P = false;
  unsigned rigid = 0;
  RowMatrix E, L, R, N, M, B, growth_E, growth_G, size_of_E, size_of_R;
  StoredSets steps, growth;                        ///< of a step; of the rule by which perturbations grow
  Vector longest;                                  ///< 2^n: time points that a set may last
  RowMatrix drift, g, at_points, growth_drift, f;  ///< (J+1) rows each
  RowMatrix seen, euler;  ///< n x m and 2^n n x n, of implicit Euler; empty: other solutions are not searched
  Vector part;            ///< m
  std::vector<int> x_unit, y_unit, w_unit;  ///< powers of ten of the rows that are returned; empty: none
};

struct SceneMarchOutcome {
  std::vector<char> settled;
  Vector residual;  ///< in the units of the scenes
};

class SceneMarch : public Plan {
 public:
  /// x0 and y_0 of the scenes, one row each. `known`: scenes whose other solutions are not searched. Work of a device
  /// may go on after the return.
  virtual void start(const RowMatrix& x0, const RowMatrix& y0, const std::vector<char>& known) = 0;
  /// Of the last start. Waits for the checks, which run while x and y are fetched.
  virtual SceneMarchOutcome outcome() = 0;
  /// Rows of all scenes, one scene after the other, in their own units: K (J+1) x m and x n.
  virtual const Array& x() = 0;
  virtual const Array& y() = 0;
};

}  // namespace bromwich
