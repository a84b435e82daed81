#pragma once
// Dynamics of a linear complementarity system with a constant active set, and the impulses with which it begins.
//
// symbol  variable      meaning
// S       active        active set: w_S = 0, and y = 0 elsewhere
// u       Jet           the values (x, f, f', g, g', g'') at one time
//
// w_S = M_SS y_S + N_S x + g_S = 0 determines y_S where M_SS is regular. Otherwise the left null space U of M_SS gives
// constraints U^T (N_S x + g_S) = 0 on the state. Their derivatives, with x' = A x + B y + f, replace the rows that
// M_SS lacks. Two derivatives are enough for diodes and relays (one) and for rigid contact (two). This is the shuffle
// algorithm for descriptor systems (Luenberger, IEEE Trans. Automat. Control 22, 1977).
//
// A state that does not fulfil the constraints jumps by B p with an impulse p of y_S: M_SS p = 0, and the constraints
// hold afterwards. With restitution e the velocities w_S' do not vanish: w_S'+ = -e w_S'-, the rebound.

#include "combination.hpp"

#include <optional>
#include <vector>

namespace bromwich {

/// A, B, N and M of a scene with dense dynamics.
struct SystemMatrices {
  Matrix A, B, N, M;
  Vector restitution = {};  ///< n coefficients of Newton's law, or empty: 0
  Index guards = 0;         ///< the last rows, which nothing sees: y_i = max(0, -w_i / M_ii) there

  Index states() const { return A.rows(); }
  Index constraints() const { return M.rows(); }
  Index pairs() const { return M.rows() - guards; }
};

struct SwitchedMode {
  std::vector<Index> active;
  Matrix A;                                                 ///< m x m, x' = A x + B (y without its part of x) + f
  Jet y, w;                                                 ///< n rows each: y and w as functions of u
  bool uses_df = false, uses_dg = false, uses_ddg = false;  ///< y depends on these
  Jet constraints;                                          ///< rows that vanish on the states of this mode
  /// Rows without x that vanish on the sources of this mode: constraints that agree, like two equal rows of w.
  Jet conditions;
  Jet condition_terms;  ///< their terms, by absolute value
  Matrix impulse;       ///< n x constraints: p = impulse * (values of the constraints and of the rebound before it)
  Matrix velocities;    ///< constraints x n: what of w' is in the constraints
  JetCombination sum_y, sum_constraints, sum_conditions;  ///< y, constraints and conditions, for polynomials
  Matrix onto;  ///< m x constraints: x -= onto * (their values) is on those without g'
};

/// n values: w_i'' by y_i of rigid contacts, where y_i acts on w_i'' alone and w does not depend on y; 0 elsewhere.
Vector openings(const SystemMatrices&);

/// w' of an open mode, n rows.
Jet rates_of_w(const SystemMatrices&);
/// The rebound with these coefficients e, n or none: e times the velocities in the constraints.
Jet rebound(const SystemMatrices&, const SwitchedMode&, const Vector& e);

/// Nothing if two derivatives do not determine y.
std::optional<SwitchedMode> make_switched_mode(const SystemMatrices&, const std::vector<Index>& active);

}  // namespace bromwich
