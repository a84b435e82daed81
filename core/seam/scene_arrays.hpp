#pragma once
// Many small dense scenes that share their dynamics and M, with sources and states at t = 0 of their own: solutions and
// their derivatives, all in arrays of a backend (core/host/held_steps.hpp). The operation is optional
// (FusedOperations::scene_arrays); without it, it runs on the host.
//
// Tables of K scenes have K (J+1) rows, one scene after the other. Those of J+1 rows are the same for all scenes.
// Values of each scene have K rows; one row is the same for all. Null: zero.

#include "../base/plan.hpp"
#include "../base/types.hpp"
#include "../host/held_steps.hpp"
#include "array.hpp"
#include "scene_march.hpp"

#include <memory>
#include <vector>

namespace bromwich {

/// Matrices of a step, x_j = E x_{j-1} + L u_{j-1} + R u_j with u = B y + f.
struct SceneArraysProblem {
  Index m = 0, n = 0, J = 0;  ///< m, n: at most scene_steps::most_held
  double h = 0;
  RowMatrix E, L, R, B, N, M;
  StoredSets steps, start;   ///< of M + N R B, and of M
  Vector longest;            ///< as SceneMarchProblem; empty: solutions are not looked at for doubts
  double most_growth = 100;  ///< of perturbations, without a doubt
};

/// What plans need beside these.
struct SceneArraysTables {
  explicit SceneArraysTables(const SceneArraysProblem&);

  RowMatrix left, right;  ///< L B, R B
  RowMatrix growth_G, size_of_E, size_of_R;
  Vector part, ones, zeros;
};

/// What the scenes are driven by.
struct SceneSources {
  const Array* x0 = nullptr;  ///< m
  const Array* f = nullptr;   ///< m, in x' = A x + B y + f
  const Array* g = nullptr;   ///< n
};

/// Changes of the data. `matrices`: scene_steps::HeldPacked.
struct SceneChange {
  SceneSources of;
  const Array* matrices = nullptr;
};

/// y (n), x (m), w (n) and the integral of y (n). As results of `forward`: K (J+1) rows, all but `integral` given.
template <class A>
struct SceneRows {
  A *y = nullptr, *x = nullptr, *w = nullptr, *integral = nullptr;
};

/// A gradient: K rows of x0, K (J+1) rows of f and g, K rows of matrices; `matrices` may be null.
struct SceneGradient {
  Array *x0 = nullptr, *f = nullptr, *g = nullptr, *matrices = nullptr;
};

class SceneArrays : public Plan {
 public:
  using States = std::vector<scene_steps::HeldState>;

  virtual Index scenes() const = 0;
  /// y (K (J+1) x n) of all scenes. Verdicts are `fine` or `unsolved`; y of an unsolved scene means nothing.
  /// `doubtful` is set by `follow`.
  virtual States solve(const SceneSources&, Array& y) = 0;
  /// x and w along this y, and whether it has a derivative. What is given here has to stay until the last derivative:
  /// `forward` and `backward` read it again.
  virtual States follow(const SceneSources&, Array& y, Array& x, Array& w) = 0;
  /// For each scene, whether it has a derivative in this direction at t = 0. Scenes whose verdict is not `fine` get
  /// numbers that mean nothing.
  virtual std::vector<char> forward(const SceneChange&, const SceneRows<Array>& out) = 0;
  /// Likewise, of a linear function of the rows.
  virtual std::vector<char> backward(const SceneRows<const Array>& of, const SceneGradient& bar) = 0;
};

class Backend;
/// Whether it steps many scenes at a time, so that copies of their tables to it pay.
bool steps_many_scenes(const Backend&);
/// On this backend, which has to outlive it. Throws Error where m or n are not in 1 .. most_held.
std::unique_ptr<SceneArrays> make_scene_arrays(Backend&, const SceneArraysProblem&, Index scenes);

}  // namespace bromwich
