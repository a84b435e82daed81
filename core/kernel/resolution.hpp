#pragma once
// Modes that a time grid does not resolve. A method whose rational function replaces e^{h lambda} (Radau IIA, implicit
// Euler) turns growth into decay where h Re lambda > 2 or so, and damps oscillations with h Im lambda > 1 away: with
// half the step too, so that a comparison of the two shows nothing.

#include "discrete_problem.hpp"

#include <functional>
#include <optional>

namespace bromwich {

struct Mode {
  Complex rate;          ///< lambda, 1/time
  double amplitude = 0;  ///< largest part of the state that it makes up, between 0 and 1 or so
};

/// The fastest mode, of A or of the closed loop of an active set of y (A - B_S M_SS^{-1} N_S, or what the constraints
/// N_S x = const leave of A where (N B)_SS is regular), that grows noticeably while the set lasts, with h |lambda| >
/// 1/2, and that the states x contain. Dense dynamics with few states.
std::optional<Mode> unresolved_growth(const DiscreteProblem&, const RowMatrix& y, const RowMatrix& x);

/// The fastest hardly damped oscillation of the same kind that makes up at least a tenth of the state, and of which the
/// rule that `damping` stands for (log |R(z)|, z = h lambda) takes away or adds a third while the set lasts.
std::optional<Mode> unresolved_oscillation(const DiscreteProblem&, const RowMatrix& y, const RowMatrix& x,
                                           double (*damping)(Complex z));

/// The fastest hardly damped oscillation of the same kind with h |Im lambda| > 1, where that is not ruled out by the
/// size of the skew part: contacts come and go within a step of it, whatever the method.
std::optional<Mode> fast_oscillation(const DiscreteProblem&, const RowMatrix& y,
                                     const std::function<RowMatrix()>& states);

/// log |R(z)| of implicit Euler and of Radau IIA with two stages.
double euler_damping(Complex z);
double radau_damping(Complex z);

}  // namespace bromwich
