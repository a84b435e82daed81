#pragma once

#include "../kernel/discrete_problem.hpp"
#include "../result/options.hpp"
#include "../result/result.hpp"
#include "forecast.hpp"

namespace bromwich {

/// The a-priori criterion for a dense scene on its grid; nothing where it would take too long to find out.
std::optional<Forecast> iteration_forecast(const DiscreteProblem&, double tolerance);

/// Steps of the longest window in time on which the functional iteration can be relied on
/// (core/iteration/forecast.hpp): J where that is the whole horizon or where nothing is known in advance.
Index iteration_window(const DiscreteProblem&, double tolerance);

/// The functional iteration window after window, `steps` time points each: a window is a scene of its own that starts
/// from the state at its left end, where y is already known. Dense dynamics. The first window that does not end solved
/// ends the whole; what lies behind it is NaN.
void solve_in_windows(const DiscreteProblem&, Index steps, const Options&, Result&);

}  // namespace bromwich
