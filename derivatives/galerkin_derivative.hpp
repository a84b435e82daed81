#pragma once
// Derivatives of a solution of method galerkin, boundary values included, with respect to b (or x0), E0, ET, f, g, A,
// B, N, M and a mass matrix. In the notation of core/galerkin/discretisation.hpp, with the active sets
// S_k = {i : (z_k)_i > 0} held,
//
//     dz_S = -D_SS^{-1} (C dx_{k-1} + dq_k)_S,      dq_k = [change of q] + dD z_k + dC x_{k-1},
//     dx_k = P_k dx_{k-1} + dF_k - H_S D_SS^{-1} (dq_k)_S,     P_k = E - H_S D_SS^{-1} C_S,
//     dF_k = [change of F] + dE x_{k-1} + dH z_k,    E0 dx_0 + ET dx_N = db - dE0 x_0 - dET x_N,
//
// a linear two-point problem (core/numerics/two_point.hpp). The gradient of a linear function Σ z̄·dz + x̄·dx is another
// one, backwards in time. With x̄'_{k-1} = x̄_{k-1} - C_S^T D_SS^{-T} (z̄_k)_S,
//
//     λ_k = P_{k+1}^T λ_{k+1} + x̄'_k,   k = N-1, ..., 0,      λ_N = x̄'_N - ET^T ν,   λ_0 = E0^T ν,
//     (μ_k)_S = D_SS^{-T} (z̄_k + H^T λ_k)_S,      F̄_k = λ_k,   q̄_k = -μ_k,   b̄ = ν.
//
// ν drops out where λ_N and λ_0 are multiplied by a basis of what is orthogonal to the columns of [-ET^T; E0^T].
//
// y has to be continuous: M of class P, or at each switch a P-matrix on what switches, with what acts on both sides of
// it eliminated.

#include "../core/galerkin/discretisation.hpp"
#include "../core/result/result.hpp"
#include "galerkin_changes.hpp"
#include "solution_derivative.hpp"

#include <array>
#include <map>
#include <vector>

namespace bromwich {

class GalerkinDerivative {
 public:
  /// The result must be of this scene, by method galerkin on intervals that it has kept, and with all of them by
  /// moments. Throws Error if it is not solved, if y may jump, where a component is degenerate (y_i = w_i = 0), and if
  /// the boundary condition does not determine the changes.
  GalerkinDerivative(const Scene&, const Result&);

  Index steps() const { return p_.N; }
  const DerivativeMargin& margin() const { return margin_; }
  const Vector& times() const { return p_.t; }
  const RowMatrix& states() const { return x_; }  ///< (N+1) x m

  /// All members; b, E0 and ET, or x0 of an initial value; f and g at the time points, linear between them. Row 0 of y
  /// is the left end of the first interval, row k the right end of interval k.
  SolutionChange jvp(const DataChange&) const;
  /// The gradient has the same members; its f has m columns, also if the scene states f = F phi. A, B, N and E are
  /// empty where sources were divided inside intervals.
  DataChange vjp(const SolutionChange&) const;

  /// A change of the discrete problem, per unit of a parameter: that of scenes with the parameter p - 2d, p - d, p + d
  /// and p + 2d, by the difference formula of derivatives/parameter_change.hpp.
  GalerkinChange change(const std::array<const Scene*, 4>&, double d) const;
  SolutionChange jvp(const GalerkinChange&) const;
  /// What multiplies a change of the discrete problem in the derivative of the function.
  GalerkinChange adjoint(const SolutionChange&) const;

 private:
  Index run_of(Index k) const;
  const GalerkinStep& step(Index k) const { return p_.runs[std::size_t(run_of(k))].step; }
  double length(Index k) const { return p_.t[k + 1] - p_.t[k]; }
  GalerkinState state() const { return {scene_, p_, z_, x_, y_}; }
  GalerkinChange no_change() const;
  void take_sets();
  void check_continuous() const;
  void judge();
  RowMatrix multipliers(const RowMatrix& of_x, Vector& of_b) const;

  Matrix inverse_E_;  ///< of the given scene; empty: E = I
  Scene scene_;       ///< with dense dynamics and E = I
  GalerkinProblem p_;
  DenseDynamics d_;
  Matrix M_;
  RowMatrix z_, x_, y_;  ///< y_: at the right ends, in row 0 at the left end of the first interval
  Index m_ = 0, n_ = 0;
  std::vector<GalerkinEntry> entries_;  ///< of the runs
  SetResponses responses_;              ///< of D; the kind is the run
  std::vector<Index> sets_;             ///< by interval
  std::map<Index, Matrix> P_;           ///< by set
  DerivativeMargin margin_;
};

}  // namespace bromwich
