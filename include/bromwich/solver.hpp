#pragma once
// Solves a scene on a backend.

#include "backend.hpp"
#include "options.hpp"
#include "result.hpp"
#include "scene.hpp"

#include <memory>
#include <vector>

namespace bromwich {

struct InnerOptions;

/// Solves the scene on t_j = j T/J. Throws Error for bad input; every other outcome is a Status in the result.
Result solve(const Scene&, Backend&, const Options& = {});

/// The whole state at chosen time points (rows of the result): m x rows.size(), from the y of a solved result and a few
/// shifted solves per time point. Throws Error for rows that are not there, or a result of another scene or of euler.
Matrix states_at(const Scene&, Backend&, const Result&, const std::vector<Index>& rows);

// A result between its time points, with the order of the method: y is linear there, and x is carried from the time
// point before, s later,
//
//     x(t_j + s) = e^{sA} x_j + ∫_0^s e^{(s-r)A} (B y(t_j + r) + f(t_j + r)) dr,
//
// by one step of the discretisation itself. Small dense states go on from x_j in steps of an eighth of h, with
// complementarity at the nodes of each. Otherwise, where a constraint switches in the step, a source jumps or y may
// jump (M singular, implicit Euler), and for x of sparse dynamics, the problem of a step of length s is solved.
// Results with located switches keep the polynomials between them, and nothing is solved again.

/// The result with rows at `times` instead of its time points: t, y, the recorded components of x, and N x if it is
/// recorded. Rows after the end of the result are NaN; so is N x between time points if no x is recorded or the scene
/// has free rows. A result whose y may jump is solved again unless all its states are recorded. Throws Error for times
/// outside [0, T], and for method goal; Interrupted where check_interruption does.
Result at_times(const Scene&, Backend&, const Result&, const std::vector<double>& times);

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
/// solves: a new g costs nothing, a new x0 or f these solves. With a tolerance every grid is kept, by its number of
/// steps. A later solve makes only grids that no earlier one has used. With a memory limit the coarse grids are dropped
/// first. All grids share e^{hA} and its phi-functions (halved steps need one doubling), fits of the kernel, shifted
/// solves, the spectrum and the class of M (`made` counts them); method galerkin shares the phi-functions. Made anew by
/// every solve: Radau IIA and split steps, the event-driven integration that a tolerance tries first, intervals of
/// method galerkin, method goal, the elimination of free rows and of a mass matrix. Natural units are those of the
/// first solve, so results differ from those of `solve` by rounding.
///
/// changed       made again
/// nothing       nothing
/// x0            its part of r; shifted solves of sparse and supplied dynamics
/// sources       samples of f and g, their part of r; with another f, shifted solves of sparse and supplied dynamics
/// f comes or goes, in a scene that is reduced: its methods
class Solver {
 public:
  /// The scene and the options are copied; the backend has to outlive the solver. Throws Error as Scene::validate.
  Solver(Scene scene, Backend& backend, Options options = {});
  ~Solver();
  Solver(const Solver&) = delete;
  Solver& operator=(const Solver&) = delete;

  /// x(0), m values. Throws Error for another length, values that are not finite, and scenes with boundary values.
  void set_x0(const Vector& x0);
  void set_x0(Vector&& x0);  ///< without a copy
  /// f, g, breakpoints and breakpoints_are_all as members of Scene. Throws Error where f and g are not finite at t = 0
  /// or the times are not in [0, T].
  void set_sources(TimeFunction f, TimeFunction g, std::vector<double> breakpoints = {},
                   bool breakpoints_are_all = false);

  /// As bromwich::solve with the scene as it is now.
  Result solve();

  /// What has been made so far for the grids of this solver.
  PreparationCounts made() const;

  const Scene& scene() const { return scene_; }

 private:
  void take_x0(Vector& x0, bool valid = false);

  Scene scene_;
  Backend& backend_;
  std::unique_ptr<InnerOptions> options_;
  RowMatrix first_iterate_;  ///< that the options point to
  Vector next_x0_;           ///< copy of an x0, which is then checked
};

}  // namespace bromwich
