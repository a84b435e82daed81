#pragma once
// Results of nonlinear systems between their time points, and in the form of linear ones.
//
// Scenes with dense matrices: a step from the time point before to the requested time is solved by Josephy-Newton, as
// in the march. Others: the result is that of the linear scene whose sources hold phi and gamma of the result, linear
// between the time points, and x and y are its values there (core/solve/dense_output.hpp).

#include "../core/result/result.hpp"
#include "solve_nonlinear.hpp"

#include <vector>

namespace bromwich {

/// Rows at `times` in place of the time points. Rows after the end of the result are NaN. With of_trace in scenes that
/// are not dense, y and v are linear between the time points. Throws Error for times outside [0, T].
NonlinearResult nonlinear_at(const NonlinearScene&, Backend&, const NonlinearResult&, const std::vector<double>& times);

/// The result in the form of a result of the linear part, so that it can be written, drawn and compared. `trace` holds
/// w - M y - g, which is N x + gamma. All states are in it, or none with of_trace in scenes that are not dense.
Result as_result(const NonlinearScene&, const NonlinearResult&);

/// What its error_estimate is the error of, in the words of a linear result.
std::string estimated_quantity(const NonlinearResult&);

}  // namespace bromwich
