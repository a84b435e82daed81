#pragma once
// A first x(0) for Newton's method on located events, where the flow over [0, T] magnifies changes so much that its
// steps lead nowhere: the state goes around an unstable solution.
//
// [0, T] is divided into K parts with states x_k of their own at their begins, Phi_k is the flow over part k and D_k
// its derivative. Newton's method for
//
//     Phi_k(x_k) = x_{k+1},   E0 x_0 + ET Phi_{K-1}(x_{K-1}) = b
//
// starts from the states on a flow that does not fulfil the boundary condition (Bock & Plitt 1984). Its linear
// equations are reduced to one for dx_0.

#include "../events/event_driven.hpp"

namespace bromwich {

/// A scene with initial values; `size`: of its states. Empty where no x(0) was found.
Vector shoot_in_parts(const Scene&, const BoundaryCondition&, LcpClass lcp_class,
                      const std::vector<double>& breakpoints, const EventOptions&, const EventSolution& guess,
                      const Vector& size);

/// Where M is zero; and those of them that no impulse of y moves, with N B = 0.
enum class RowsOfStart : char { without_compliance, without_impulses };
/// min |z - x| / size with N z + g(0) >= 0 in these rows.
Vector nearest_feasible(const Scene&, const Vector& x, const Vector& size,
                        RowsOfStart = RowsOfStart::without_compliance);

}  // namespace bromwich
