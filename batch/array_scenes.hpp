#pragma once
// Small dense scenes that share their dynamics and M, whose sources and results are arrays of the backend: nothing of
// the size of the time points passes through the host. Each scene has x0, f and g of its own, or shares them
// (core/seam/scene_arrays.hpp). The solution is that of method march with a continuous y, and its derivatives are those
// of SolutionDerivative.

#include "../core/scene/scene.hpp"
#include "../core/seam/backend.hpp"
#include "../core/seam/scene_arrays.hpp"
#include "../derivatives/set_margin.hpp"
#include "../derivatives/step_direction.hpp"

#include <memory>
#include <string>
#include <vector>

namespace bromwich {

/// The steps of dense dynamics without a mass matrix. Precondition: m and n in 1 .. scene_steps::most_held.
SceneArraysProblem scene_arrays_problem(const DenseDynamics&, const Matrix& M, double T, Index J);

/// Why a scene has no solution or no derivative, in one line that begins with "not differentiable here" where it is the
/// derivative; empty where it has one. `h`: of a step.
std::string in_words(const scene_steps::HeldState&, double h);

class ArrayScenes {
 public:
  /// x0, f and g of the scene are not used. Throws Error for scenes with boundary values, free rows, a mass matrix,
  /// more than scene_steps::most_held states or constraints, and where y may jump. The backend has to outlive this
  /// object.
  ArrayScenes(const Scene&, Backend&, Index steps, Index scenes);

  Index scenes() const { return plan_->scenes(); }
  Index steps() const { return problem_.J; }
  Index states() const { return problem_.m; }
  Index constraints() const { return problem_.n; }

  /// K lines: empty, or why the scene is not solved. The sources have to stay until the last derivative.
  std::vector<std::string> solve(const SceneSources&);
  /// Of the last solve: K (J+1) rows.
  const Array& y() const { return *y_; }
  const Array& x() const { return *x_; }
  const Array& w() const { return *w_; }
  /// K lines: empty, or why the scene has no derivative. Of the last solve.
  const std::vector<std::string>& reasons() const { return reasons_; }
  std::vector<DerivativeMargin> margins() const;

  /// Gradients with respect to the matrices, K each.
  struct ByMatrices {
    std::vector<Matrix> A, B, N, M;
  };
  /// Of a linear function of the rows, after a solve. `bar.matrices` is not used: gradients by matrices go to `by`,
  /// where they are wanted. Returns K lines as reasons(), which may be more of them.
  std::vector<std::string> vjp(const SceneRows<const Array>& of, const SceneGradient& bar, ByMatrices* by);

 private:
  ByMatrices taken_apart(const RowMatrix& sums) const;

  Backend& backend_;
  SceneArraysProblem problem_;
  StepDirections directions_;
  std::unique_ptr<SceneArrays> plan_;
  std::unique_ptr<Array> y_, x_, w_, sums_;
  SceneArrays::States states_;
  std::vector<std::string> reasons_;
};

}  // namespace bromwich
