#pragma once
// One scene, prepared once and solved many times with other initial values and sources.

#include "../result/inner_options.hpp"
#include "solve.hpp"

#include <memory>
#include <vector>

namespace bromwich {

/// Keeps what does not depend on x0, f and g: fits of the kernel, factorizations, plans, arrays on the host and on the
/// device. The first solve makes it.
///
///     Solver solver(scene, *backend, options);
///     Result first = solver.solve();
///     solver.set_x0(x0);
///     Result second = solver.solve();
///
/// What is kept, by method: march, euler and dual of dense scenes and Kronecker sums, contour and multigrid of all:
/// everything but r, x0's part of it and y. Sparse and supplied dynamics have x0 and f as columns of the shifted
/// solves: a new g costs nothing, a new x0 or f these solves. Made anew by every solve: Radau IIA and split steps,
/// methods galerkin and goal, grids of a tolerance, the elimination of free rows and of a mass matrix. Natural units
/// are those of the first solve, so results differ from those of `solve` by rounding.
class Solver {
 public:
  /// The scene and the options are copied; the backend has to outlive the solver. Throws Error as Scene::validate.
  Solver(Scene scene, Backend& backend, Options options = {});
  Solver(const Solver&) = delete;
  Solver& operator=(const Solver&) = delete;

  /// x(0), m values. Throws Error for another length, values that are not finite, and scenes with boundary values.
  void set_x0(const Vector& x0);
  void set_x0(Vector&& x0);  ///< without a copy
  /// f and g as functions of time, as Scene::f and Scene::g, with the times where they may jump. Throws Error where
  /// they are not finite at t = 0 or the times are not in [0, T].
  void set_sources(TimeFunction f, TimeFunction g, std::vector<double> breakpoints = {});

  /// As bromwich::solve with the scene as it is now.
  Result solve();

  const Scene& scene() const { return scene_; }

 private:
  void take_x0(Vector& x0, bool valid = false);

  Scene scene_;
  Backend& backend_;
  InnerOptions options_;
  RowMatrix first_iterate_;  ///< that the options point to
  Vector next_x0_;           ///< where an x0 is copied to and looked at
};

}  // namespace bromwich
