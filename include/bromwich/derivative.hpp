#pragma once
// Derivatives of a solution with respect to its data, with a continuous y. The dynamics are written out as dense
// matrices, with E x' = A x + ... as x' = E^{-1} A x + ...
//
// The discrete solution is y linear between time points, u_j = B y_j + f_j, and
//
//     x_j = ξ_j + R u_j,   ξ_j = E x_{j-1} + L u_{j-1},   E = e^{hA}, L = h (phi_1 - phi_2)(hA), R = h phi_2(hA),
//     w_j = N x_j + M y_j + g_j,   (w_j)_S = 0,   (y_j)_i = 0 for i not in S,   S = S_j = {i : (y_j)_i > 0}.
//
// Where no component has y_i = w_i = 0, small changes of the data leave the sets S_j as they are, and y, x and w are
// differentiable. With W = M + N R B a change of the data gives
//
//     dy_S = -W_SS^{-1} (N dξ + dN x + dM y + dg)_S,   dξ_j = E dx_{j-1} + L du_{j-1} + dE x_{j-1} + dL u_{j-1} + ...
//
// (jvp: one pass forward), and a linear function of y, x and w has the gradient that one pass backward gives (vjp):
//
//     p_j = x̄_j + E^T q_{j+1},   (μ_j)_S = W_SS^{-T} (ȳ_j + B^T R^T p_j + B^T L^T q_{j+1})_S,   q_j = p_j - N^T μ_j,
//
// with ḡ_j = -μ_j, f̄_j = R^T q_j + L^T q_{j+1}. Derivatives of E, L and R with respect to A are blocks of the same
// functions of [[A, dA], [0, A]] (Higham, Functions of Matrices, theorem 3.6).

#include "goal.hpp"
#include "result.hpp"
#include "scene.hpp"

#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace bromwich {

class SetResponses;
class SwitchedTape;
struct NaturalUnits;

/// How far the solution is from a point at which it is not differentiable.
struct DerivativeMargin {
  /// The smallest max(y_i, w_i) at a time point, relative to the largest y_i and w_i of the component.
  double margin = 1;
  double time = 0;
  Index constraint = -1;
  /// Of switches that are located: the smallest T |c'| at one, c the y_i or w_i that vanishes, relative to the largest
  /// value of c. Near 0, the switch is grazing: a small change of the data removes it.
  double transversality = INFINITY;
  double grazing_time = 0;
};

/// A change of the data, or a gradient with respect to it. Empty: no change, or in a gradient no rows.
struct DataChange {
  Vector x0;       ///< m
  RowMatrix f, g;  ///< (J+1) x m and (J+1) x n: at the time points, linear between them
  Matrix A, B, N, M;
  Matrix E = {};            ///< where the scene has a mass matrix
  Vector b = {};            ///< m, where the scene has a boundary condition
  Matrix E0 = {}, ET = {};  ///< m x m, likewise
  Vector restitution = {};  ///< n: where impacts are located
};

/// By the modes of memories, one number for each memory.
using ChangesInModes = std::map<std::vector<Index>, DataChange>;

/// A time at which f or g jumps, and how it changes.
struct MovingJump {
  double t = 0, change = 0;
};

/// y, x and w at the time points, or a linear function of them: (J+1) x n, m, n. Empty: no part in the function.
struct SolutionChange {
  RowMatrix y, x, w;
  RowMatrix integral;  ///< (J+1) x n: of y over [0, t_j], impulses included
};

/// Whether y of the result may jump: SolutionDerivative refuses it, SwitchedDerivative takes its scene.
bool y_may_jump(const Result&);

class SolutionDerivative {
 public:
  /// The result must be of this scene, on a grid of equal steps, by `march`, `contour` or `multigrid`. Throws Error if
  /// it is not solved, or if y may jump: the derivative of the discrete solution is then not that of the solution.
  /// Throws Error, too, if a degenerate component (y_i = w_i = 0) leaves only one-sided derivatives, or if the scene is
  /// too large for dense matrices.
  SolutionDerivative(const Scene&, const Result&);

  Index steps() const { return J_; }
  const DerivativeMargin& margin() const { return margin_; }
  const Vector& times() const { return t_; }
  const RowMatrix& states() const { return x_; }  ///< (J+1) x m

  SolutionChange jvp(const DataChange&) const;
  /// The gradient with respect to all data; its f has m columns, also if the scene states f = F phi.
  DataChange vjp(const SolutionChange&) const;

 private:
  void follow(const Result&);
  void check_start(const SolutionChange&, const RowMatrix& fixed) const;

  DataChange without_mass(DataChange) const;
  void add_mass(DataChange&) const;

  DenseDynamics d_;   ///< with E = I
  Matrix inverse_E_;  ///< of the scene; empty: E = I
  RowMatrix f_;       ///< (J+1) x m, in x' = ... + f
  Matrix M_, E_, L_, R_;
  Index J_ = 0, m_ = 0, n_ = 0;
  double h_ = 0;
  Vector t_;
  RowMatrix y_, x_, u_, w_;
  std::shared_ptr<const SetResponses> responses_;  ///< of W, and of M at t = 0
  std::vector<Index> sets_;                        ///< S_j, as the index of its response
  std::vector<Index> undecided_;                   ///< undecided_at_start
  DerivativeMargin margin_;
};

// Derivatives of a solution whose switches are located, also where y or x jumps.
//
// Between switches the active set S is constant, and a change of the data obeys the dynamics of S with other
// sources, exactly solved on each part:
//
//     dx' = A dx + B dy + f~,   (N dx + M dy + g~)_S = 0,   f~ = dA x + dB y + df,   g~ = dN x + dM y + dg.
//
// c is the y_i or w_i that vanishes at a switch, c(x, t) = 0. The time of the switch changes by dt = -dc/c' and the
// state by the saltation (Aizerman & Gantmacher 1958; di Bernardo et al., Piecewise-smooth Dynamical Systems, 2008,
// section 2.5)
//
//     dx+ = dx- + (x'- - x'+) dt,
//
// with the derivative of the map x+ = x- + B p where the state jumps, by the coefficients of restitution too. The
// integral of y gets (y- - y+) dt + dp. vjp is the transpose of all these maps in reverse order. A change of M has to
// keep the left kernel of a singular M_SS, as that of the coefficient of friction of a contact does: U^T dM_SS = 0 for
// U^T M_SS = 0, so that the constraints on the state stay what they are, and p changes by -M_SS^+ dM_SS p beside what
// the constraints ask for.
//
// At a change of the mode of a memory c is its condition, the dynamics behind it are those of the new mode, and states
// that the memory sets do not change. A change of A, ..., g counts in all modes.
//
// With E0 x(0) + ET x(T) = b, and D the derivative of x(T) by x(0), x(0) changes by
//
//     (E0 + ET D) dx0 = db - dE0 x(0) - dET x(T) - ET dphi,
//
// where dphi is the change of x(T) with x(0) held.
//
// A switch is differentiable if the set after it stays the one after it: each component that vanishes there has to
// vanish with c to first order. Otherwise (two switches at once, a grazing switch, y_i = w_i = 0 for some time, events
// that accumulate) the constructor refuses: not differentiable here.

class SwitchedDerivative {
 public:
  static constexpr double usual_tolerance = 1e-11;

  /// `times`: increasing, from 0 to T, those of all tables. Throws Error where the scene is not dense and small, where
  /// the integration with located switches ends early, and where the solution is not differentiable. `along_some`:
  /// where constraints with y_i = w_i = 0 at a switch, at t = 0, or from one switch to the next leave a derivative
  /// along changes that keep them so, that is one; other changes throw Error. `tolerance`: of the integration.
  /// `start`: with a boundary condition, an x(0) near that of the solution, and behind it the numbers of the modes of
  /// memories; empty: none is known.
  SwitchedDerivative(const Scene&, const Vector& times, bool along_some = false, double tolerance = usual_tolerance,
                     const Vector& start = {});
  ~SwitchedDerivative();
  SwitchedDerivative(SwitchedDerivative&&) noexcept;

  const Vector& times() const { return t_; }
  /// Limits from the right (at T: from the left) at the times.
  const SolutionChange& values() const { return values_; }
  const DerivativeMargin& margin() const { return margin_; }
  /// Times at which the active set changes with the solution.
  const std::vector<double>& switches() const { return switch_times_; }
  /// Members of `times` at a switch: their rows are limits from the right, and a derivative from one side.
  const std::vector<Index>& one_sided() const { return one_sided_; }
  /// Empty, or why there is no derivative with respect to M: y jumps at a switch, or M_SS is singular.
  const std::string& without_M() const { return without_M_; }

  /// Empty, or why only some changes have a derivative.
  const std::string& only_along() const { return only_along_; }

  /// x(0) and the modes of memories, from which the boundary condition was met; empty without one.
  const Vector& start() const { return start_; }

  /// The modes of memories that the solution comes to; without memories one without numbers.
  std::vector<std::vector<Index>> modes() const;

  /// Throws Error for a change of M where there is no derivative with respect to it.
  SolutionChange jvp(const DataChange&) const;
  /// The same where times at which f or g jump change, too. Throws Error for times that are no breakpoints of the
  /// scene.
  SolutionChange jvp(const DataChange&, const std::vector<MovingJump>&) const;
  /// Of a scene with memories, by a change for all of modes() of the scene that with_memory_rows makes of it.
  SolutionChange jvp(const ChangesInModes&, const std::vector<MovingJump>&) const;
  /// M is empty where there is no derivative with respect to it. Without a boundary condition, where only some changes
  /// have a derivative, all members are empty on which its conditions depend: x0; f, A, B and E; or g, N and M. Throws
  /// Error where none is left (with a boundary condition x(0) depends on all), and for weights on one-sided rows.
  DataChange vjp(const SolutionChange&) const;

 private:
  using ChangeInModes = std::function<const DataChange&(const std::vector<Index>&)>;
  void scale(SolutionChange&) const;
  void scale(DataChange&) const;
  void prepare(DataChange&) const;
  struct Ends;
  void find_start(Scene&, double tolerance, const Vector& start);
  SolutionChange jvp(const ChangeInModes&, const DataChange& any, const std::vector<MovingJump>&) const;
  Vector change_of_start(const ChangeInModes&, const DataChange& any, const std::vector<MovingJump>&) const;
  DataChange with_ends(SolutionChange of, const Vector& of_start) const;

  Vector t_;
  SolutionChange values_;
  DerivativeMargin margin_;
  std::vector<double> switch_times_;
  std::vector<Index> one_sided_;
  std::string without_M_, only_along_;
  std::unique_ptr<const NaturalUnits> units_;
  std::unique_ptr<Ends> ends_;  ///< with a boundary condition
  Vector start_;
  Index m_, n_;                               ///< with the modes of memories, and the rows that watch them
  Matrix inverse_E_;                          ///< empty: E = I
  std::unique_ptr<const SwitchedTape> tape_;  ///< in natural units
};

// Derivatives of a quantity of interest with respect to the data of a scene: the quantity of the discrete states, x a
// line between the time points,
//
//     I = ∫ j(t, x) dt + e(x(T)),   dI = Σ_i x̄_i · dx_i,
//
// whose weights x̄ go into the vjp of a derivative. With an open end at a switch (one-sided rows) they are refused
// there.

struct QuantityChange {
  double value = 0;        ///< I of the discrete states
  SolutionChange weights;  ///< x̄ alone: (J+1) x m
};

/// `x`: the states at the times t, all of them. Throws Error for a quantity of the energy balance where the scene is
/// not port-Hamiltonian, and for tables of another shape.
QuantityChange quantity_change(const QuantityOfInterest&, const Scene&, const Vector& t, const RowMatrix& x);

}  // namespace bromwich
