#pragma once

#include "../kernel/discrete_problem.hpp"
#include "../result/options.hpp"
#include "../result/result.hpp"
#include "forecast.hpp"

namespace bromwich {

/// The a-priori criterion for a dense scene on its grid; empty if it would take too long to compute.
std::optional<Forecast> iteration_forecast(const DiscreteProblem&, double tolerance);

/// Steps of the longest window in time on which the functional iteration is reliable (core/iteration/forecast.hpp); J
/// if that is the whole horizon or unknown.
Index iteration_window(const DiscreteProblem&, double tolerance);

/// The functional iteration in consecutive windows of `steps` time points. A window is a scene of its own that starts
/// from the state at its left end, where y is already known. Dense dynamics. After the first window that is not solved
/// the iteration ends, and all later values are NaN.
void solve_in_windows(const DiscreteProblem&, Index steps, const Options&, Result&);

}  // namespace bromwich
