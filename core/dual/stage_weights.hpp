#pragma once
// Weights of convolution quadrature by Radau IIA with two stages. A function F(z) with the exponentials c/(z - s) of a
// PoleSum has one state for each of them, stepped by the rule with y at both stages as its input:
//
//     X = x_{j-1} 1 + h a (s X + Y_j),   v_j = c X,   x_j = X_2,
//
// a constant b has the weights b I, and z is Delta(zeta)/h = a^{-1} (I - zeta 1 e_2^T)/h.

#include "../kernel/transfer_fit.hpp"
#include "../seam/backend.hpp"
#include "../seam/recurrence.hpp"

#include <functional>
#include <memory>

namespace bromwich {

/// a^{-1} and a^{-1} 1 of Radau IIA.
inline constexpr double radau_inverse[2][2] = {{1.5, 0.5}, {-4.5, 2.5}};
inline constexpr double radau_inverse_ones[2] = {2, -2};

/// Modes l with F_l(z) = G(z - mu_l); `exact` gives F_l itself, from which the weights within a step are made. A fit of
/// one function serves all modes, or there is one for each.
StageRecurrence stage_recurrence(const PoleSum&, const Vector& mu, double h,
                                 const std::function<Complex(Index mode, Complex z)>& exact);

/// Tables of J lags for a fit of the n n entries of a matrix, row by row.
struct StageTables {
  Weights parts[2][2];
  std::unique_ptr<Convolution> convolution(Backend&, Index n, Index rows) const;
};
std::shared_ptr<const StageTables> stage_tables(const PoleSum&, Index n, double h, Index J);

/// The same for implicit Euler.
LagTable euler_table(const PoleSum&, Index n, double h, Index J);

}  // namespace bromwich
