#pragma once

#include "time_operator.hpp"

namespace bromwich {

/// The operator for the dynamics of the scene.
std::unique_ptr<TimeOperator> make_time_operator(const DiscreteProblem&);

std::unique_ptr<TimeOperator> make_dense_operator(const DiscreteProblem&);
std::unique_ptr<TimeOperator> make_modal_operator(const DiscreteProblem&);
std::unique_ptr<TimeOperator> make_lag_operator(const DiscreteProblem&);
std::unique_ptr<TimeOperator> make_pole_operator(const DiscreteProblem&);

/// Whether few poles are predicted to cost less than lag weights. Both need shifted solves, the poles a third of them;
/// a table of J n^2 weights is read by every application. Small tables stay: they are more accurate than a fit.
bool poles_pay(const DiscreteProblem&);
inline constexpr double fewest_tabulated = 1 << 20;  ///< J n^2 from which poles are used: 16 MB of weights

}  // namespace bromwich
